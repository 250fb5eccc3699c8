// Reads the board of this tab, a board on USB, or a recording, and sends the page what its panels show. All of
// it is in a worker: a hidden tab loses no frame.
import { lifted, move } from "./hand.js";
import { Light } from "./light.js";
import { Player } from "./player.js";
import { described, read, Recorder } from "./recording.js";
import { Session } from "./session.js";
import { draw, simulatedBoard } from "./simulated.js";
import { UsbBoard } from "./usb.js";

const SLICE_MS = 5;  // time between two looks; the board of this tab runs so far behind the page
const HURRY_US = 10_000;  // the board runs so long between two looks at its replies, while it starts
const EVENTS_KEPT = 512, SHOW_MS = 250;
const json = (path) => fetch(path).then((answer) => answer.json());
const decoded = (text) => Uint8Array.from(atob(text), (one) => one.charCodeAt(0));

async function loaded(name) {
  const strip = await json(`strips/${name}.json`);
  return { ...strip, light: await (lights[strip.light] ??= json(`lights/${strip.light}.json`)) };
}

// Parts and events that the page has not got yet. One message is under way at a time.
let news = {}, events = [], missed = 0, sent = 0, drawn = 0;
const page = {
  put: (part, value) => { news[part] = value; },
  event: (one) => {
    events.push(one);
    if (events.length > EVENTS_KEPT) missed += events.splice(0, events.length - EVENTS_KEPT).length;
  },
};
function show() {
  if (drawn < sent || !(Object.keys(news).length || events.length)) return;
  postMessage({ n: ++sent, parts: { ...news, events, ...(missed && { missed }) } });
  [news, events, missed] = [{}, [], 0];
}

const [firmware, layouts, words] = await Promise.all(["firmware.json", "layouts.json", "words.json"].map(json));
// All strips, so that the page needs no network when it has been loaded.
const lights = {};
const strips = Object.fromEntries(Object.keys(words.strips).map((name) => [name, loaded(name)]));
const boardFile = fetch("board.py").then((answer) => answer.text());
// `session` is what the page shows; `tab` the board of this tab, which stops while another board is shown.
let session = null, tab = null, light = null, usb = null, player = null, recorder = null, hurrying = false;

// The board of this tab.

async function startTab(strip) {
  light = new Light(strip.light, draw);
  const own = new Session({ send: (bytes) => tab.send(bytes), name: "this tab", page, words, layouts });
  tab = await simulatedBoard({
    files: Object.fromEntries(Object.entries(firmware.files).map(([path, text]) => [path, decoded(text)])), glue: await boardFile,
    config: firmware.config, id: firmware.id, light, noise: strip.light.noise,
    onBytes: (bytes) => own.take(bytes, performance.now()),
    onReport: (name, report) => {
      if (name === "gamepad") page.put("stick", stick(report));
      else postMessage({ report: { name, report: [...report] } });
    },
  });
  tab.session = session = own;
}

// Waits for commands, for which the board runs as fast as it can.
async function hurried(done) {
  let waits = true;
  hurrying = true;
  done.catch(() => {}).finally(() => { waits = false; });
  while (waits) {
    tab.hurry(HURRY_US);
    await null;
  }
  hurrying = false;
  return done;
}

// Stores everything, and restarts the board, so that it becomes a USB keyboard and gamepad.
async function restart() {
  await session.commands.command("set keys=1 gamepad=1");
  await session.commands.command("save");
  await session.commands.command("reboot");
  await session.begin();
}

async function useStrip(strip) {
  light.tables = strip.light;
  session.expected = strip.expected;
  await session.commands.command(strip.settings);
  await session.commands.upload("cal", strip.calibration.lines);
  await restart();
}

async function pushLayout(name) {
  await session.commands.upload("layout", layouts[name].lines);
  if (session === tab?.session) return restart();
  await session.commands.command("save");
  return session.begin();
}

function stick(report) {
  const view = new DataView(report.buffer), axis = (at) => view.getInt16(at, true) / 32767, buttons = view.getUint16(6, true);
  return { x: axis(0), y: axis(2), z: axis(4), buttons: [0, 1, 2, 3].map((i) => Boolean(buttons >> i & 1)), held: false };
}

// A board on USB, and recordings.

// `names` are those of the keys on this computer, see caps.js.
async function connect(names) {
  await leave();
  usb = new UsbBoard({
    protocol: words.protocol,
    say: (state, message, next) => page.put("board", { ...session?.known, state, message, next }),
    begin: (send) => session = new Session({ send, name: "USB", page, words: { ...words, names: { ...words.names, ...names } }, layouts }),
  });
  usb.run();
}

async function play(file) {
  const { header, entries } = await read(file);
  await leave();
  const name = file.name;
  session = new Session({ send: () => {}, name, page, words, layouts });
  session.feed.use(layouts.digits);
  session.known = { ...header.info, port: name, strip: 0, strips: [], layout: header.info.length_um ? layouts.digits.shown : null };
  session.say("connected");
  page.put("recording", null);
  player = new Player(entries, (frame, nowMs) => session.show(frame, nowMs));
}

// Leaves the board on USB or the recording.
async function leave() {
  if (recorder) stopRecording();
  await usb?.stop();
  if (session !== tab?.session) session?.end("another board is shown");
  usb = player = session = null;
  page.put("recording", IDLE);
}

// Recordings of the board that is shown. The page gets the file at the end.

const IDLE = { on: false, playing: null, error: null };
let marks = 0;
const recorded = () => ({
  ...IDLE, on: Boolean(recorder), file: recorder.file, bytes: recorder.bytes, seconds: recorder.seconds, lost: session.decoder.stats.lost, marks,
});

async function startRecording() {
  recorder = new Recorder(await described(session), `spots live ${firmware.version}`);
  marks = 0;
  session.tap = (bytes, nowMs) => recorder.take(bytes, nowMs);
}

function stopRecording() {
  postMessage({ file: recorder.end(), name: recorder.file });
  page.put("recording", { ...recorded(), on: false });
  session.tap = recorder = null;
}

const record = { start: startRecording, stop: stopRecording, mark: () => recorder?.mark(`mark ${++marks}`) };

let shownMs = 0;
setInterval(() => {
  const nowMs = performance.now();
  if (session && session === tab?.session && !hurrying) lifted(light.fingers, tab.runUntil(nowMs - SLICE_MS));
  if (player) {
    player.tick(nowMs);
    if (player.ended) {
      session.say("connected", "the recording has ended");
      page.put("recording", null);
      player = null;
    }
  } else if (!hurrying) session?.tick(nowMs);
  if (recorder && nowMs - shownMs > SHOW_MS) {
    shownMs = nowMs;
    page.put("recording", recorded());
  }
  show();
}, SLICE_MS);

// Requests of the page, by their path; each returns its answer.
const requests = {
  finger: (one) => { if (tab) move(light.fingers, one, tab.timeUs(one.atMs - performance.timeOrigin)); },
  strip: async (name) => {
    const strip = await strips[name];
    await leave();
    if (!tab) await startTab(strip);
    session = tab.session;
    await hurried(useStrip(strip));
  },
  layout: (name) => (session === tab?.session ? hurried(pushLayout(name)) : pushLayout(name)),
  world: (world) => { if (light) Object.assign(light, world); },
  usb: connect,
  play,
  command: (line) => session.commands.command(line),
  calibration: async (lines) => { await session.commands.upload("cal", lines); await session.begin(); },
  recording: (what) => record[what](),
};

onmessage = async ({ data: { drawn: last, id, path, body } }) => {
  if (last !== undefined) {
    drawn = last;
    return;
  }
  try {
    if (!(path in requests)) throw new Error("this page has no server: run 'spots serve' for this");
    postMessage({ id, answer: (await requests[path](body)) ?? {} });
  } catch (error) {
    postMessage({ id, answer: { refused: error.message ?? String(error) } });
  }
};

page.put("board", { state: "searching", message: "", next: "" });
page.put("may_command", true);
page.put("recording", IDLE);
const named = Object.fromEntries(Object.entries(layouts).map(([name, one]) => [name, one.shown.name]));
postMessage({ ready: { layouts: named, strips: words.strips } });
