// Pointers and keys that press the drawn strip.
import { make } from "./dom.js";
import { ask } from "./link.js";

const STEP_MM = 1, LONG_STEP_MM = 8.5;  // of the arrow keys, without and with shift
const KEYS = { ArrowLeft: -1, ArrowDown: -1, ArrowRight: 1, ArrowUp: 1 };

// Lets pointers press `root`, which shows a strip of `lengthMm()`. A pen or a touch screen that measures its
// pressure sets the force; otherwise the force grows while the finger is held.
export function press(root, lengthMm) {
  const guide = root.querySelector(".guide"), track = guide.querySelector(".track"), shadows = new Map();
  Object.assign(guide, { tabIndex: 0, role: "slider", ariaLabel: "Press the strip: arrow keys move a finger, the space bar presses" });
  guide.classList.add("pressable");

  function send(id, xMm, down, atMs, pressure = 0) {
    ask("finger", { id, xMm, down, pressure, atMs: performance.timeOrigin + atMs });
    draw(id, xMm, down);
  }

  // A ring shows where the finger really is; the strip draws where the board measures it.
  function draw(id, xMm, down) {
    let ring = shadows.get(id);
    if (!down) {
      ring?.remove();
      shadows.delete(id);
      return;
    }
    if (!ring) shadows.set(id, ring = track.appendChild(make("div", "ring")));
    ring.style.left = `${100 * xMm / lengthMm()}%`;
  }

  const at = ({ clientX }) => {
    const { left, width } = track.getBoundingClientRect();
    return Math.min(Math.max((clientX - left) / width, 0), 1) * lengthMm();
  };
  const pressure = (event) => (event.pointerType === "mouse" || event.pressure === 0.5 || event.pressure === 1 ? 0 : event.pressure);
  const held = new Set();
  guide.addEventListener("pointerdown", (event) => {
    if (event.button > 0) return;
    guide.setPointerCapture(event.pointerId);
    held.add(event.pointerId);
    send(event.pointerId, at(event), true, event.timeStamp, pressure(event));
  });
  guide.addEventListener("pointermove", (event) => {
    if (held.has(event.pointerId)) send(event.pointerId, at(event), true, event.timeStamp, pressure(event));
  });
  for (const end of ["pointerup", "pointercancel", "lostpointercapture"]) {
    guide.addEventListener(end, (event) => {
      if (held.delete(event.pointerId)) send(event.pointerId, at(event), false, event.timeStamp);
    });
  }

  // One finger of the keyboard.
  const ID = "keys";
  let xMm = lengthMm() / 2, down = false;
  const say = () => Object.assign(guide, { ariaValueMin: 0, ariaValueMax: lengthMm(), ariaValueNow: xMm.toFixed(0), ariaValueText: `${xMm.toFixed(0)} mm` });
  say();
  guide.addEventListener("keydown", (event) => {
    if (event.key in KEYS) {
      xMm = Math.min(Math.max(xMm + KEYS[event.key] * (event.shiftKey ? LONG_STEP_MM : STEP_MM), 0), lengthMm());
      say();
      if (down) send(ID, xMm, true, event.timeStamp);
      else draw(ID, xMm, true);
    } else if (event.key === " ") {
      if (!event.repeat) send(ID, xMm, down = true, event.timeStamp);
    } else return;
    event.preventDefault();
  });
  const lift = (event) => { if (down) send(ID, xMm, down = false, event.timeStamp); };
  guide.addEventListener("keyup", (event) => { if (event.key === " ") lift(event); });
  guide.addEventListener("blur", (event) => { lift(event); draw(ID, xMm, false); });
}
