// The board of this tab: the firmware in MicroPython for WebAssembly, on a simulated chip and bus. Its
// port has the interface that port.js describes.
import { loadMicroPython } from "./micropython/micropython.mjs";
import { AS7341 } from "./chip/as7341.js";
import { I2CBus } from "./chip/bus.js";

const HEAP_BYTES = 1 << 20;
const PERIOD_US = 2 ** 30;  // ticks wrap as on a microcontroller
const SLICE_US = 4000;  // the board runs this time, then the page can change the light
const LATE_US = 250_000;  // a board that is behind by more skips time: the tab was stopped

// Returns a normally distributed random number (Box and Muller).
export function draw() {
  return Math.sqrt(-2 * Math.log(1 - Math.random())) * Math.cos(2 * Math.PI * Math.random());
}

// `files`: the firmware, by path, as bytes. `glue`: the text of board.py.in. `light`: see light.js. `noise`: see
// converter.js. `onBytes(bytes)` gets what the board sends; `onReport(name, report)` its USB reports.
// `hardware` is that of board.py.in in place of a simulated one.
export async function simulatedBoard({ files, glue, config, id, light, noise, onBytes, onReport, hardware, onPrint = console.log }) {
  const clock = { timeUs: 0 }, toBoard = [];
  globalThis.board = hardware ?? simulated({ clock, toBoard, bus: new I2CBus(new AS7341(light, noise, draw), clock, config.I2C_HZ), onBytes, onReport });
  const python = await loadMicroPython({ heapsize: HEAP_BYTES, stdout: onPrint, stderr: onPrint });
  for (const [path, content] of Object.entries(files)) {
    const folders = path.split("/").slice(0, -1);
    folders.forEach((_, i) => { try { python.FS.mkdir(`/${folders.slice(0, i + 1).join("/")}`); } catch { /* there already */ } });
    python.FS.writeFile(`/${path}`, content);
  }
  python.runPython(`import sys\nsys.path.append("/")\n${glue}`);
  python.globals.get("start")(id, JSON.stringify(config));
  const run = python.globals.get("run");
  let startedMs = null;  // of performance.now() at time 0 of the board

  return {
    run,
    send: (data) => { toBoard.push(...data); },
    // Runs the board for a time without waiting, for example while it starts.
    hurry(us) {
      run(clock.timeUs + us);
      startedMs = null;
    },
    // Runs the board up to the time of a moment, in ms of performance.now(); returns its time in us.
    runUntil(nowMs) {
      startedMs ??= nowMs - clock.timeUs / 1000;
      let untilUs = 1000 * (nowMs - startedMs);
      if (untilUs - clock.timeUs > LATE_US) {
        startedMs += (untilUs - clock.timeUs - SLICE_US) / 1000;
        untilUs = 1000 * (nowMs - startedMs);
      }
      while (clock.timeUs < untilUs) run(Math.min(clock.timeUs + SLICE_US, untilUs));
      return clock.timeUs;
    },
    timeUs: (atMs) => 1000 * (atMs - (startedMs ?? atMs)),
  };
}

// The hardware that board.py.in uses; times are in us.
function simulated({ clock, toBoard, bus, onBytes, onReport }) {
  return {
    now: () => Math.floor(clock.timeUs) % PERIOD_US,
    time: () => clock.timeUs,
    sleep: (us) => { clock.timeUs += us; },
    read: (address, register, size) => {
      const data = new Uint8Array(size);
      return bus.writeRead(address, register, data) || hex(data);
    },
    write: (address, data) => bus.write(address, bytes(data)),
    send: (frame) => onBytes(bytes(frame)),
    receive: () => toBoard.shift() ?? -1,
    report: (name, report) => onReport(name, bytes(report)),
  };
}

function hex(data) {
  return Array.from(data, (byte) => byte.toString(16).padStart(2, "0")).join("");
}

function bytes(text) {
  return Uint8Array.from({ length: text.length / 2 }, (_, i) => parseInt(text.slice(2 * i, 2 * i + 2), 16));
}
