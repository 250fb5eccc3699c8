// Draws the messages of the server in the next frame of the screen, and acknowledges them.

import { placed } from "./dom.js";
import { connect } from "./link.js";
import { load } from "./plugins.js";
import { board } from "./panels/board.js";
import { figures } from "./panels/figures.js";
import { calibration } from "./panels/calibration.js";
import { editor } from "./panels/editor.js";
import { controller } from "./panels/controller.js";
import { gestures } from "./panels/gestures.js";
import { strip } from "./panels/strip.js";
import { strips } from "./panels/strips.js";
import { beside } from "./panels/beside.js";
import { history } from "./panels/history.js";
import { spectrum } from "./panels/spectrum.js";
import { keyboard } from "./panels/keyboard.js";
import { stick } from "./panels/stick.js";
import { recordings } from "./panels/recordings.js";
import { recording } from "./panels/recording.js";
import { next } from "./panels/next.js";
import { link } from "./panels/link.js";

// Each panel, its largest drawing rate per second, and the parts of the state that it shows. Panels
// that follow the finger are drawn in every frame, charts less often, and text least often.
const ANSWER = Infinity, LOOK = 15, READ = 5;  // drawings per second
const PANELS = [
  [strip, ANSWER, "board", "touch"],
  [keyboard, ANSWER, "board", "touch", "keys"],
  [editor, ANSWER, "editor", "may_command", "board", "touch", "keys"],
  [controller, LOOK, "controller", "may_command", "board", "touch", "stick"],
  [gestures, LOOK, "gestures", "may_command", "board"],
  [calibration, LOOK, "calibration", "hold", "may_command", "board"],
  [figures, READ, "board", "touch"],
  [board, READ, "board", "connection"],
  [stick, LOOK, "stick"],
  [spectrum, LOOK, "board", "touch", "spectrum"],
  [history, LOOK, "touch", "board"],
  [beside, LOOK, "beside", "board"],
  [strips, READ, "board", "may_command", "calibration"],
  [recording, READ, "recording", "may_command"],
  [recordings, READ, "recording", "may_command"],
  [link, READ, "link"],
  [next, READ, "board", "touch", "untrusted", "calibration", "connection", "recording"],
];
// Panels whose drawing was postponed are drawn with the next messages, or this time after the last one.
const QUIET_MS = 100;

// A panel is a function of its element that returns a draw function: (state, news, now_s). `state`
// has the newest value of every part. `news` has the parts that changed since the panel's last
// drawing. It also has lists of everything since then: `events`, `touches` (values of the part touch)
// and `besides` (values of the part beside). If the draw function returns true, it is called again.
// A page without the element of a panel does not show it.
const panels = PANELS.filter(([make]) => document.getElementById(make.name))
  .map(([make, ...how]) => panel(make(document.getElementById(make.name)), ...how));

function panel(draw, rate, ...parts) {
  return { draw, parts, every_ms: 1000 / rate, due_ms: 0, news: null };
}

const EMPTY = () => ({ events: [], touches: [], besides: [] });
const loaded = new Set();

// Adds the panels of other packages, which the server lists in its first message.
function add(listed) {
  for (const one of listed) {
    if (loaded.has(one.name)) continue;
    loaded.add(one.name);
    load(one, (draw, ...parts) => {
      panels.push({ ...panel(draw, LOOK, ...parts), news: EMPTY() });
      ask();
    });
  }
}

const state = {};
let asked = false, arrived = false, quiet = 0, newest = null;

const receipt = connect(
  (parts) => {
    const { events, missed, ...changed } = parts;
    take(changed, events);
    if (changed.board && changed.board.state !== "connected") clear();
  },
  (how) => {
    document.body.dataset.link = how;
    take({ connection: how, may_command: false, hold: null });
    if (how !== "live") clear();
  },
);

// Clears stale parts when the board or the server is lost.
function clear() {
  const link = state.link && { ...state.link, rate_hz: null, latency_ms: null };
  take({ touch: null, stick: null, keys: null, untrusted: null, beside: {}, link });
}

function take(parts, events = []) {
  const touched = placed(state.touch);
  Object.assign(state, parts);
  if (parts.panels) add(parts.panels);
  if (parts.application) document.body.dataset.application = parts.application;
  // When a press begins or ends, no panel waits for its drawing interval.
  if (placed(state.touch) !== touched) for (const panel of panels) panel.due_ms = 0;
  newest = parts.touch ?? newest;
  arrived = true;
  for (const panel of panels) {
    if (!panel.news && !events.length && !panel.parts.some((part) => part in parts)) continue;
    const news = panel.news ??= EMPTY();
    Object.assign(news, parts);
    news.events.push(...events);
    if (parts.touch) news.touches.push(parts.touch);
    if (parts.beside) news.besides.push(parts.beside);
  }
  ask();
}

function ask() {
  if (!asked) {
    asked = true;
    requestAnimationFrame(frame);
  }
}

function frame(now_ms) {
  asked = false;
  const due = panels.filter(({ news, due_ms }) => news && due_ms <= now_ms);
  // While messages arrive, a frame draws the panels that follow the finger, and only one other panel:
  // the one that is overdue longest. With more panels the frame would be late.
  const [longest] = due.filter(({ every_ms }) => every_ms).sort((a, b) => a.due_ms - b.due_ms);
  for (const panel of due) {
    if (arrived && panel.every_ms && panel !== longest) continue;
    const { news } = panel;
    panel.due_ms = now_ms + panel.every_ms;
    panel.news = null;
    if (panel.draw(state, news, now_ms / 1000)) panel.news = EMPTY();
  }
  arrived = false;
  clearTimeout(quiet);
  if (panels.some(({ news }) => news)) quiet = setTimeout(ask, QUIET_MS);
  if (newest) document.dispatchEvent(new CustomEvent("drawn", { detail: newest }));
  newest = null;
  shown.push(receipt());
  after.port2.postMessage(null);
}

// The frame is on the screen when the next task begins.
const after = new MessageChannel(), shown = [];
after.port1.onmessage = () => shown.shift()();
