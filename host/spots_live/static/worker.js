// Runs the board of this tab, or reads the board on USB, and sends the page what its panels show. All of it
// is in a worker: a hidden tab loses no frame.
import { Commands } from "./commands.js";
import { Decoder } from "./decoder.js";
import { Feed } from "./feed.js";
import { lifted, move } from "./hand.js";
import { Light } from "./light.js";
import { draw, simulatedBoard } from "./simulated.js";

const SLICE_MS = 5;  // the board of this tab runs so far behind the page, in slices of this time
const HURRY_US = 10_000;  // the board runs so long between two looks at its replies, while it starts
const EVENTS_KEPT = 512;
const STREAMS = "stream contact touch spectrum";
const json = (path) => fetch(path).then((answer) => answer.json());

// Parts and events that the page has not got yet. One message is under way at a time.
let news = {}, events = [], missed = 0, sent = 0, drawn = 0;
const put = (part, value) => { news[part] = value; };
function event(one) {
  events.push(one);
  if (events.length > EVENTS_KEPT) missed += events.splice(0, events.length - EVENTS_KEPT).length;
}
function show() {
  if (drawn < sent || !(Object.keys(news).length || events.length)) return;
  postMessage({ n: ++sent, parts: { ...news, events, ...(missed && { missed }) } });
  [news, events, missed] = [{}, [], 0];
}

const [firmware, layouts, words] = await Promise.all(["firmware.json", "layouts.json", "words.json"].map(json));
const feed = new Feed(put, event, words);
let board = null, light = null, decoder = null, commands = null, strip = null, layout = "digits", known = {}, hurrying = false;

async function boot() {
  decoder = new Decoder();
  light = new Light(strip.light, draw);
  const glue = await fetch("board.py").then((answer) => answer.text());
  const files = Object.fromEntries(Object.entries(firmware.files).map(([path, text]) => [path, Uint8Array.from(atob(text), (one) => one.charCodeAt(0))]));
  board = await simulatedBoard({
    files, glue, config: firmware.config, id: firmware.id, light, noise: strip.light.noise, onBytes, onReport,
  });
  commands = new Commands(board.send);
  setInterval(run, SLICE_MS);
}

// Waits for commands, for which the board runs as fast as it can.
async function hurried(done) {
  let waits = true;
  done.finally(() => { waits = false; }).catch(() => {});
  hurrying = true;
  while (waits) {
    board.hurry(HURRY_US);
    await null;
  }
  hurrying = false;
  return done;
}

function run() {
  if (hurrying) return;
  const nowMs = performance.now();
  const timeUs = board.runUntil(nowMs - SLICE_MS);
  lifted(light.fingers, timeUs);
  feed.health(decoder.stats, nowMs);
  show();
}

function onBytes(bytes) {
  const nowMs = performance.now();
  for (const frame of decoder.feed(bytes)) {
    if (frame.kind === "text") commands.take(frame.content);
    else feed.take(frame, frame.t_us * 1e-6, nowMs);
  }
}

function onReport(name, report) {
  if (name === "gamepad") put("stick", stick(report));
  else postMessage({ report: { name, report: [...report] } });
}

function stick(report) {
  const view = new DataView(report.buffer), axis = (at) => view.getInt16(at, true) / 32767, buttons = view.getUint16(6, true);
  return { x: axis(0), y: axis(2), z: axis(4), buttons: [0, 1, 2, 3].map((i) => Boolean(buttons >> i & 1)), held: false };
}

// Changes the light to that of a chosen strip, and gives the board its calibration.
async function useStrip() {
  light.tables = strip.light;
  await commands.command(strip.settings);
  await commands.upload("cal", strip.calibration.lines);
  await restart();
}

async function useLayout(name) {
  layout = name;
  await commands.upload("layout", layouts[name].lines);
  await restart();
}

// Stores everything, restarts the board so that it becomes a USB keyboard, and starts the streams.
async function restart() {
  await commands.command("set keys=1 gamepad=1");
  await commands.command("save");
  await commands.command("reboot");
  await begin();
}

async function begin() {
  const info = await commands.command("hello"), { dark, full_scale } = await commands.command("get");
  known = {
    ...info, full_scale, port: board.name, strip: 0, strips: [{ id: info.id, calibration: info.calibration, length_um: info.length_um }],
    start: "", expected: strip.expected && { ...strip.expected, dark: dark.map((sum) => sum / 64) }, layout: layouts[layout].shown,
  };
  feed.use(layouts[layout]);
  put("board", { state: "connected", message: "", next: "", ...known });
  await commands.command(STREAMS);
}

// Requests of the page, by their path; each returns its answer.
const requests = {
  finger: (one) => { if (board) move(light.fingers, one, board.timeUs(one.atMs - performance.timeOrigin)); },
  strip: async (name) => {
    strip = await json(`strips/${name}.json`);
    if (!board) await boot();
    await hurried(useStrip());
  },
  layout: (name) => hurried(useLayout(name)),
  world: ({ drift, lampUW, dust }) => { Object.assign(light, { drift, lampUW, dust }); },
};

onmessage = async ({ data: { drawn: last, id, path, body } }) => {
  if (last !== undefined) {
    drawn = last;
    return;
  }
  try {
    postMessage({ id, answer: (await requests[path](body)) ?? {} });
  } catch (error) {
    postMessage({ id, answer: { refused: error.message ?? String(error) } });
  }
};

put("board", { state: "searching", message: "", next: "" });
const named = Object.fromEntries(Object.entries(layouts).map(([name, one]) => [name, one.shown.name]));
postMessage({ ready: { layouts: named, strips: words.strips } });
