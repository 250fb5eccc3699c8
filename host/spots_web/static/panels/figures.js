// Position and force of the press as numbers, and the flags of the reading in words.
import { FULL_FORCE_MN, fill, make, placed, several } from "../dom.js";

export function figures(root) {
  const place = figure("Position", "mm"), force = figure("Force", "N");
  const bar = make("i");
  force.root.append(make("div", "meter", bar));
  const words = make("div", "words");
  root.append(place.root, force.root, words);

  return (state, news) => {
    if ("board" in news) force.unit(state.board?.relative_force ? "relative" : "N");
    if (!("touch" in news)) return;
    const touch = state.touch, there = placed(touch);
    const said = several(touch) ? "two fingers" : touch ? touch.flags.join(", ") : "";
    if (said !== words.textContent) words.textContent = said;
    place.show(there ? (touch.position_um / 1000).toFixed(2)
      : several(touch) ? [...touch.fingers].sort((a, b) => a - b).map((um) => (um / 1000).toFixed(1)).join(" · ") : null);
    const sigma_um = there ? touch.sigma_um ?? null : null;
    place.note(sigma_um === null ? "" : `± ${(sigma_um / 1000).toFixed(2)} mm`);
    place.root.classList.toggle("pair", several(touch));
    for (const { root } of [place, force]) root.classList.toggle("doubtful", there && !touch.trusted);
    force.show(there ? (touch.force_mN / 1000).toFixed(2) : null);
    fill(bar, there ? touch.force_mN / FULL_FORCE_MN : 0);
  };
}

function figure(name, unit) {
  const number = document.createTextNode("");
  const value = make("b", "", number, make("small", "", unit)), last = value.lastChild;
  const note = make("small"), root = make("div", "figure none", make("span", "", name), value, note);
  const show = (text) => {
    root.classList.toggle("none", text === null);
    number.data = text ?? "–";
  };
  show(null);
  return { root, show, unit: (text) => { last.textContent = text; }, note: (text) => { note.textContent = text; } };
}
