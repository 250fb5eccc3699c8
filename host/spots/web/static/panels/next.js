// Why the strip cannot be read, and the next step; empty if there is no problem.
import { several } from "../dom.js";

export function next(root) {
  return (state) => {
    const sentence = state.connection !== "live"
      ? "the server does not answer; next: start 'spots serve' again, and this window reconnects"
      : state.board?.next || both(state.touch) || state.untrusted || "";
    if (root.textContent !== sentence) root.textContent = sentence;
    root.hidden = !sentence;
  };
}

function both(touch) {
  if (!several(touch)) return "";
  const places = [...touch.fingers].sort((a, b) => a - b).map((um) => (um / 1000).toFixed(1));
  return `two fingers touch, at about ${places.join(" and ")} mm; next: lift one of them for an exact position`;
}
