// Runs the firmware in MicroPython for WebAssembly with recorded answers of bus and clock, for
// test_firmware.py. Standard input is a JSON object: the folder of the page, the board's id, and the entries.
// Standard output is what the board sends, in hexadecimal. It fails if a request differs from the record.

import fs from "node:fs";
import path from "node:path";

const { page, id, typed: first, entries } = JSON.parse(fs.readFileSync(0, "utf8"));
const { simulatedBoard } = await import(path.join(page, "simulated.js"));
const firmware = JSON.parse(fs.readFileSync(path.join(page, "firmware.json"), "utf8"));
const EIO = 5;  // after the last entry
const sent = [];
let next = 0, timeUs = 0, typed = [...Buffer.from(first, "hex")];

function answered(kind, ...given) {
  const entry = entries[next++];
  if (!entry) return null;
  if (JSON.stringify(entry.asked) !== JSON.stringify([kind, ...given])) {
    throw new Error(`request ${next} is ${JSON.stringify([kind, ...given])}, not ${JSON.stringify(entry.asked)}`);
  }
  timeUs = entry.time_us;
  typed.push(...Buffer.from(entry.typed, "hex"));
  return entry.answer;
}

const hardware = {
  now: () => Math.floor(timeUs) % 2 ** 30,
  time: () => (next < entries.length ? 0 : 1),
  sleep: (us) => { answered("sleep", us); },
  read: (address, register, size) => answered("read", address, register.toString(16).padStart(2, "0"), size) ?? EIO,
  write: (address, data) => answered("write", address, data) ?? 0,
  send: (frame) => { if (next <= entries.length) sent.push(frame); },
  receive: () => typed.shift() ?? -1,
  report: () => {},
};
const board = await simulatedBoard({
  files: Object.fromEntries(Object.entries(firmware.files).map(([name, text]) => [name, Buffer.from(text, "base64")])),
  glue: fs.readFileSync(path.join(page, "board.py"), "utf8"), config: { ...firmware.config, NAME: "virtual" }, id, hardware,
});
board.run(1);
console.log(sent.join(""));
