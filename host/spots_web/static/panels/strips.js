// Buttons that choose the strip to show in detail; editors and calibration change this strip.
import { button } from "../controls.js";
import { make } from "../dom.js";
import { request } from "../request.js";

export function strips(root) {
  const note = make("span"), row = make("div", "choices");
  note.role = "status";
  root.append(row, note);
  const touch = document.getElementById("touch"), name = touch.querySelector(".strip-name");
  const history = document.querySelector("#history h2");
  let count = 0;

  async function choose(number) {
    note.textContent = (await request("strip", String(number))).refused ?? "";
  }

  return (state) => {
    const { board } = state, all = board?.strips ?? [], editable = state.may_command && all.length > 1;
    root.hidden = !editable || Boolean(state.calibration?.running);
    if (count !== all.length) {
      count = all.length;
      row.replaceChildren(...all.map((_, i) => button(`strip ${i}`, () => choose(i))));
    }
    [...row.children].forEach((one, i) => one.setAttribute("aria-pressed", String(i === board.strip)));
    name.hidden = all.length < 2;
    name.textContent = name.hidden ? "" : `Strip ${board.strip}`;
    touch.ariaLabel = name.textContent || "Strip";
    const past = name.hidden ? "Last ten seconds" : `Last ten seconds of strip ${board.strip}`;
    if (history.textContent !== past) history.textContent = past;
  };
}
