// The sentence at the lower edge: why the strip has no valid reading, and the next step for the user.
import { several } from "../dom.js";

export function next(root) {
  let last = null;
  const draw = () => {
    const state = last, reading = state.calibration?.running ? "" : sentence(state.touch, state.untrusted);
    const words = state.connection !== "live"
      ? "the server does not answer; next: start 'spots serve' again, and this window reconnects"
      : state.board?.next || played(state.recording) || (reading && strip(state.board) + here(state, reading)) || state.board?.start || here(state, fingerMissing(state.board)) || "";
    if (root.textContent !== words) root.textContent = words;
    root.hidden = !words;
  };
  // A click can open a panel, which changes the words of its button.
  document.addEventListener("click", () => last && draw());
  return (state) => {
    last = state;
    draw();
  };
}

// Returns the way to a button of a panel: if the panel is closed, first the button that opens it.
function way(opener, ...words) {
  const open = document.getElementById(opener).ariaExpanded === "true";
  const steps = [...(open ? [] : [`press ‘${document.getElementById(opener).textContent}’`]), ...words];
  return steps.join(", then ");
}

function played(recording) {
  return recording?.playing ? `the recording ${recording.playing} is played; next: to see the board again, ${way("open-recordings", "press ‘Show the board’")}` : "";
}

// The sentence of `finger_missing` in spots/advice/calibrated.py.
function fingerMissing(board) {
  return board?.presser === "no_finger" ? "calibrated with an indenter, not yet with a finger; next: spots rezero" : "";
}

function strip(board) {
  return board?.strips?.length > 1 ? `strip ${board.strip}: ` : "";
}

// If this browser may calibrate, the next step names a button of this window instead of a command.
function here(state, reading) {
  if (!reading || !state.may_command || !state.calibration) return reading;
  return reading
    .replace("spots rezero", (command) => (state.calibration.rezero ? way("calibrate", "press ‘Re-zero’") : command))
    .replace("spots calibrate", () => way("calibrate", "choose ‘Rough’ or ‘Fine’"));
}

// Returns cause and next step if readings are not valid; an empty text if they are valid.
export function sentence(touch, untrusted) {
  return both(touch) || (untrusted ?? "");
}

function both(touch) {
  if (!several(touch)) return "";
  const places = [...touch.fingers].sort((a, b) => a - b).map((um) => (um / 1000).toFixed(1));
  return `two fingers touch, at about ${places.join(" and ")} mm; next: lift one of them for an exact position`;
}
