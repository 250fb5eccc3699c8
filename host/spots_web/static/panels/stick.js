// The state of a gamepad: position, force and buttons.
import { fill, make } from "../dom.js";

export function stick(root) {
  const knob = make("div", "knob"), bar = make("i");
  const rail = make("div", "rail", knob);
  const buttons = make("div", "row");
  root.append(rail, make("div", "row", make("span", "", "Z"), make("div", "meter", bar), buttons));

  return (state, news) => {
    if (!("stick" in news)) return;
    const it = state.stick;
    root.hidden = !state.board?.length_um;
    if (it && buttons.children.length !== it.buttons.length) {
      buttons.replaceChildren(...it.buttons.map((_, i) => make("div", "button", String(i + 1))));
    }
    knob.style.transform = `translateX(${50 * (it?.x ?? 0)}cqw)`;
    fill(bar, it?.z ?? 0);
    [...buttons.children].forEach((one, i) => one.classList.toggle("on", it?.buttons[i] ?? false));
  };
}
