// The six channels of a reading, and their expected counts for a press at this position.
import { fill, make, placed, several } from "../dom.js";

// Colour of the light that each channel measures.
const COLOURS = {
  F1: "#7600ed", F2: "#0028ff", F3: "#00b8e6", F4: "#1fd400", F5: "#9be000",
  F6: "#f2c800", F7: "#ff4f00", F8: "#d00000", CLEAR: "#a0a0a0", NIR: "#8a5a5a",
};
const LEAST_TOP = 1000;  // counts at full width if the full scale is unknown; more if a channel has more

const COUNTED_S = 0.2;  // interval at which numbers change, slow enough to read

export function spectrum(root) {
  const bars = root.appendChild(make("div", "bars"));
  const note = make("span"), legend = make("span", "legend", "expected");
  root.append(make("p", "note", note, legend));
  let rows = [], fit = null, counted_s = 0;
  legend.hidden = true;

  function lay(plan) {
    rows = plan.map((name) => {
      const bar = make("i"), tick = make("u"), count = make("b");
      bar.style.background = COLOURS[name] ?? COLOURS.CLEAR;
      const rail = make("div", "", make("div", "whole", bar), tick);
      return { bar, tick, count, root: make("div", "bar", make("span", "", name), rail, count) };
    });
    bars.replaceChildren(...rows.map((row) => row.root));
  }

  return (state, news, now_s) => {
    if (news.board?.channels) lay(news.board.channels);
    if (news.touch) {
      const word = !news.touch.touching ? "no press" : several(news.touch) ? "two fingers"
        : news.touch.flags.includes("not one press") ? "does not fit one press"
        : news.touch.flags.includes("not calibrated") ? "not calibrated" : "fits one press";
      if (word !== fit) {
        fit = note.textContent = word;
        note.classList.toggle("warn", word === "does not fit one press");
      }
    }
    if (!state.spectrum || !rows.length) return;
    const { counts } = state.spectrum;
    const top = state.board.full_scale || Math.max(LEAST_TOP, ...counts);
    const wanted = placed(state.touch) ? expected(state.board.expected, state.touch) : null;
    legend.hidden = !wanted;
    counts.forEach((value, i) => {
      const { bar, tick, count } = rows[i];
      fill(bar, value / top);
      tick.classList.toggle("on", Boolean(wanted));
      if (wanted) tick.style.transform = `translateX(${100 * Math.min(wanted[i] / top, 1)}cqw)`;
      if (now_s - counted_s >= COUNTED_S) count.textContent = value;
    });
    if (now_s - counted_s >= COUNTED_S) counted_s = now_s;
  };
}

// Returns the expected counts for the position and the brightness of a reading, interpolated between
// the positions for which the server sent spectra.
function expected(curve, { position_um, brightness }) {
  if (!curve) return null;
  const { from_um, step_um, logs, dark } = curve;
  const at = Math.min(Math.max((position_um - from_um) / step_um, 0), logs.length - 1);
  const below = Math.min(Math.floor(at), logs.length - 2);
  return dark.map((counts, i) => {
    const [a, b] = [logs[below][i], logs[below + 1][i]];
    return counts + 2 ** (a + (b - a) * (at - below) + brightness);
  });
}
