// The strip, the press on it, its place and its force.
import { FULL_FORCE_MN, fill, make } from "../dom.js";

const USUAL_LENGTH_UM = 85000;
const STEPS_MM = [1, 2, 5, 10, 20, 50, 100], MOST_TICKS = 9;

export function strip(root) {
  const place = figure("Position", "mm"), force = figure("Force", "N");
  const bar = make("i");
  force.root.append(make("div", "meter", bar));
  const words = make("div", "words");
  const press = make("div", "press");
  const track = make("div", "track", press);
  const ticks = make("div", "ticks");
  root.append(make("div", "figures", place.root, force.root, words), make("div", "guide", track), ticks);
  let length_um = USUAL_LENGTH_UM;
  scale();

  function scale() {
    const length_mm = length_um / 1000;
    const step = STEPS_MM.find((one) => length_mm / one <= MOST_TICKS) ?? length_mm;
    const places = Array.from({ length: Math.floor(length_mm / step) + 1 }, (_, i) => i * step);
    ticks.replaceChildren(...places.map((mm, i) => {
      const tick = make("span", "", i ? `${mm}` : "0 mm");
      tick.style.left = `${(100 * mm) / length_mm}%`;
      return tick;
    }));
  }

  return (state, news) => {
    if (news.board) {
      length_um = news.board.length_um ?? USUAL_LENGTH_UM;
      scale();
    }
    if (!("touch" in news)) return;
    const touch = state.touch;
    const placed = Boolean(touch?.touching) && !touch.flags.includes("not calibrated");
    press.classList.toggle("on", placed);
    words.textContent = touch ? touch.flags.join(", ") : "";
    place.show(placed ? (touch.position_um / 1000).toFixed(2) : null);
    force.show(placed ? (touch.force_mN / 1000).toFixed(2) : null);
    fill(bar, placed ? touch.force_mN / FULL_FORCE_MN : 0);
    root.dataset.positionUm = placed ? touch.position_um : "";
    if (!placed) return;
    press.classList.toggle("doubtful", !touch.trusted);
    const share = Math.min(Math.max(touch.position_um / length_um, 0), 1);
    const size = 0.55 + 0.75 * Math.min(touch.force_mN / FULL_FORCE_MN, 1);
    press.style.transform = `translateX(${share * track.clientWidth}px) scale(${size})`;
  };
}

function figure(name, unit) {
  const number = document.createTextNode("");
  const value = make("b", "", number, make("small", "", unit));
  const root = make("div", "figure none", make("span", "", name), value);
  const show = (text) => {
    root.classList.toggle("none", text === null);
    number.data = text ?? "–";
  };
  show(null);
  return { root, show };
}
