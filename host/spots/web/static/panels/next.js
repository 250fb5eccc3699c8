// What keeps the strip or one of the strips from being shown, and the next step; else empty.
import { several } from "../dom.js";

export function next(root) {
  return (state) => {
    const reading = state.calibration?.running ? "" : both(state.touch) || state.untrusted;
    const sentence = state.connection !== "live"
      ? "the server does not answer; next: start 'spots serve' again, and this window reconnects"
      : state.board?.next || played(state.recording) || reading || strips(state);
    if (root.textContent !== sentence) root.textContent = sentence;
    root.hidden = !sentence;
  };
}

function played(recording) {
  return recording?.playing ? `the recording ${recording.playing} is played; next: to see the board again, press ‘Show the board’ in the list of recordings` : "";
}

function strips({ board, twin }) {
  return board?.sensors > 1 && !twin
    ? `this board has ${board.sensors} strips, and the first is shown; next: to see the other one, start 'spots serve --port ${board.port}#1'` : "";
}

function both(touch) {
  if (!several(touch)) return "";
  const places = [...touch.fingers].sort((a, b) => a - b).map((um) => (um / 1000).toFixed(1));
  return `two fingers touch, at about ${places.join(" and ")} mm; next: lift one of them for an exact position`;
}
