// The six channels behind a reading.
import { fill, make } from "../dom.js";

// What a channel's band looks like.
const COLOURS = {
  F1: "#7600ed", F2: "#0028ff", F3: "#00b8e6", F4: "#1fd400", F5: "#9be000",
  F6: "#f2c800", F7: "#ff4f00", F8: "#d00000", CLEAR: "#a0a0a0", NIR: "#8a5a5a",
};
const LEAST_TOP = 1000;

export function spectrum(root) {
  const bars = root.appendChild(make("div", "bars"));
  const note = root.appendChild(make("p", "note"));
  let rows = [], fit = null;

  function lay(plan) {
    rows = plan.map((name) => {
      const bar = make("i"), count = make("b");
      bar.style.background = COLOURS[name] ?? COLOURS.CLEAR;
      return { bar, count, root: make("div", "bar", make("span", "", name), make("div", "", bar), count) };
    });
    bars.replaceChildren(...rows.map((row) => row.root));
  }

  return (state, news) => {
    if (news.board?.plan) lay(news.board.plan);
    if (news.touch) {
      const word = !news.touch.touching ? "no press"
        : news.touch.flags.includes("not one press") ? "does not fit one press"
        : news.touch.flags.includes("not calibrated") ? "not calibrated" : "fits one press";
      if (word !== fit) {
        fit = note.textContent = word;
        note.classList.toggle("warn", word === "does not fit one press");
      }
    }
    if (!news.spectrum || !rows.length) return;
    const { counts } = news.spectrum;
    const top = state.board.full_scale || Math.max(LEAST_TOP, ...counts);
    counts.forEach((value, i) => {
      fill(rows[i].bar, value / top);
      rows[i].count.textContent = value;
    });
  };
}
