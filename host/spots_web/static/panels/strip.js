// The strip and the press on it. Because the strip is drawn in every frame, no code here makes the
// browser compute the layout.
import { FULL_FORCE_MN, make, placed, several } from "../dom.js";

const USUAL_LENGTH_UM = 85000;
const STEPS_MM = [1, 2, 5, 10, 20, 50, 100], MOST_TICKS = 9;  // of the ruler

export function strip(root) {
  const press = make("div", "press"), others = [make("div", "other"), make("div", "other")];
  const track = make("div", "track", press, ...others);
  const ticks = make("div", "ticks");
  root.append(make("div", "guide", track), ticks);
  let length_um = USUAL_LENGTH_UM;
  ruler(ticks, length_um);

  const at = (um) => Math.min(Math.max(um / length_um, 0), 1);

  return (state, news) => {
    if (news.board) {
      length_um = news.board.length_um ?? USUAL_LENGTH_UM;
      ruler(ticks, length_um);
    }
    if (!("touch" in news)) return;
    const touch = state.touch, there = placed(touch);
    others.forEach((one, i) => {
      one.classList.toggle("on", several(touch));
      if (several(touch)) one.style.transform = `translateX(${100 * at(touch.fingers[i])}cqw) scale(0.7)`;
    });
    press.classList.toggle("on", there);
    if (!there) return;
    press.classList.toggle("doubtful", !touch.trusted);
    const size = 0.55 + 0.75 * Math.min(touch.force_mN / FULL_FORCE_MN, 1);
    press.style.transform = `translateX(${100 * at(touch.position_um)}cqw) scale(${size})`;
  };
}

// Fills an element with the marks of a ruler, for a strip of a length in um.
export function ruler(ticks, length_um) {
  const length_mm = length_um / 1000;
  const step = STEPS_MM.find((one) => length_mm / one <= MOST_TICKS) ?? length_mm;
  const places = Array.from({ length: Math.floor(length_mm / step) + 1 }, (_, i) => i * step);
  ticks.replaceChildren(...places.map((mm, i) => {
    const tick = make("span", "", i ? `${mm}` : "0 mm");
    tick.style.left = `${(100 * mm) / length_mm}%`;
    return tick;
  }));
}
