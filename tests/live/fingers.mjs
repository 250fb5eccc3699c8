// Presses the strip of the page `live` with fingers in simulated time, for test_people.py. Standard input is a
// JSON object: the folder of the page, and events of pointers with their times in ms. Standard output is a JSON
// list of the key frames. The loop is that of worker.js.

import fs from "node:fs";
import path from "node:path";

const STEP_MS = 5;
let seed = 1;
Math.random = () => {  // the same noise in each run; a linear congruential generator
  seed = (1664525 * seed + 1013904223) % 2 ** 32;
  return (seed + 0.5) / 2 ** 32;
};
globalThis.performance.now = () => 0;

const { page, events, seconds } = JSON.parse(fs.readFileSync(0, "utf8"));
const load = (name) => import(path.join(page, name)), json = (name) => JSON.parse(fs.readFileSync(path.join(page, name), "utf8"));
const [{ simulatedBoard, draw }, { Light }, { Session }, { lifted, move }] = await Promise.all(["simulated.js", "light.js", "session.js", "hand.js"].map(load));
const firmware = json("firmware.json"), strip = json("strips/default.json"), tables = json("lights/default.json"), layouts = json("layouts.json"), words = json("words.json");
const light = new Light(tables, draw), keys = [];
const session = new Session({ send: (bytes) => board.send(bytes), name: "", page: { put() {}, event() {} }, words, layouts });
const board = await simulatedBoard({
  files: Object.fromEntries(Object.entries(firmware.files).map(([name, text]) => [name, Buffer.from(text, "base64")])),
  glue: fs.readFileSync(path.join(page, "board.py"), "utf8"), config: firmware.config, id: firmware.id, light, noise: tables.noise,
  onBytes: (bytes) => session.take(bytes, 0), onReport: () => {},
});

async function hurried(done) {
  let waits = true;
  done.finally(() => { waits = false; });
  while (waits) {
    board.hurry(1000 * STEP_MS);
    await null;
  }
  return done;
}
const { commands } = session;
await hurried(commands.command(strip.settings));
await hurried(commands.upload("cal", strip.calibration.lines));
await hurried(commands.upload("layout", layouts.digits.lines));
for (const line of ["set keys=1", "save", "reboot"]) await hurried(commands.command(line));
await hurried(session.begin());

session.feed.take = (frame) => { if (frame.kind === "key") keys.push(frame); };
for (let ms = 0; ms < 1000 * seconds; ms += STEP_MS) {
  lifted(light.fingers, board.runUntil(ms - STEP_MS));
  while (events.length && events[0].atMs < ms) move(light.fingers, events[0], board.timeUs(events.shift().atMs));
}
console.log(JSON.stringify(keys));
