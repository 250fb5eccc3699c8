// Recordings: writes the bytes of a board to a .spots file, and plays such a file; see the page "Format of a
// recording".
import { crc32, Decoder } from "./decoder.js";

const VERSION = 1, PIECE = 200, COPIES = 2;  // of the header: characters in a note, number of its copies
const ARRIVAL_STEP_MS = 5;  // bytes that arrive within this time share one note
const FILE_MAX = 64 << 20, NOTE = 15;

// Returns a payload and its CRC as COBS, with its delimiter.
function framed(payload) {
  const crc = new Uint8Array(4);
  new DataView(crc.buffer).setUint32(0, crc32(payload), true);
  const out = [];
  let block = [];
  const end = () => { out.push(block.length + 1, ...block); block = []; };
  for (const byte of [...payload, ...crc]) {
    if (byte === 0) end();
    else if (block.push(byte) === 254) end();
  }
  end();
  return Uint8Array.of(...out, 0);
}

function note(sinceMs, content) {
  const us = Math.round(1000 * sinceMs), body = content ? new TextEncoder().encode(JSON.stringify(content)) : [];
  const head = new DataView(new ArrayBuffer(7));
  head.setUint8(0, NOTE);
  head.setUint16(1, Math.floor(us / 2 ** 32), true);
  head.setUint32(3, us % 2 ** 32, true);
  return framed(Uint8Array.of(...new Uint8Array(head.buffer), ...body));
}

// Asks a board for what the header needs: its clock, its dark frame and its calibration.
export async function described({ commands, info, dark }) {
  const beganS = performance.now() / 1000, { t_us } = await commands.command("sync"), endedS = performance.now() / 1000;
  const lines = [];
  for (let of = info.calibration ? Infinity : 0; lines.length < of; ) {
    const reply = await commands.command(`cal lines ${lines.length}`);
    lines.push(...reply.lines);
    of = reply.of;
  }
  const at_s = t_us * 1e-6;
  return {
    info, dark: [dark], calibration: lines.length ? lines : null,
    clock: { last_us: t_us, at_us: t_us, low_s: beganS - at_s, high_s: endedS - at_s, slope: 0 },
  };
}

export class Recorder {
  bytes = 0;
  #parts = [];
  #begun = false;  // whether the first whole frame has begun
  #noteMs = 0;
  #tail = [];
  #marks = [];  // notes that wait for the end of a frame

  // `about` is what `described` returns; `program` the name and version of this program.
  constructor(about, program) {
    this.startMs = performance.now();
    this.file = `${new Date().toISOString().slice(0, 19).replaceAll(":", "")}.spots`;
    const header = {
      recording: VERSION, program, set: crypto.randomUUID().replaceAll("-", "").slice(0, 16), part: 0, host_s: this.startMs / 1000,
      utc_s: Date.now() / 1000, restarts: 0, sequence: null, ...about,
    };
    // ASCII, so that no cut divides a character.
    const text = JSON.stringify(header).replace(/[\u007f-\uffff]/g, (one) => `\\u${one.charCodeAt(0).toString(16).padStart(4, "0")}`);
    const of = Math.ceil(text.length / PIECE);
    for (let copy = 0; copy < COPIES; copy++) {
      for (let i = 0; i < of; i++) this.#write(note(0, { header: text.slice(PIECE * i, PIECE * (i + 1)), i, of }));
    }
  }

  // Takes bytes of the board, which arrived at a time of performance.now().
  take(bytes, nowMs) {
    const first = this.#begun ? 0 : bytes.indexOf(0) + 1;
    if (!this.#begun && !first) return;
    this.#begun = true;
    const end = bytes.lastIndexOf(0) + 1;
    if (end > first) {
      if (nowMs >= this.#noteMs) {
        this.#noteMs = nowMs + ARRIVAL_STEP_MS;
        this.#write(note(nowMs - this.startMs));
      }
      this.#write(Uint8Array.of(...this.#tail, ...bytes.subarray(first, end)));
      this.#tail = [];
      for (const mark of this.#marks.splice(0)) this.#write(mark);
    }
    this.#tail.push(...bytes.subarray(Math.max(first, end)));
  }

  get seconds() {
    return (performance.now() - this.startMs) / 1000;
  }

  // Marks the present moment.
  mark(text) {
    this.#marks.push(note(performance.now() - this.startMs, { mark: text }));
  }

  // Ends the recording; returns its bytes (Blob).
  end() {
    this.#write(note(performance.now() - this.startMs, { end: true }));
    return new Blob(this.#parts, { type: "application/octet-stream" });
  }

  #write(bytes) {
    this.bytes += bytes.length;
    this.#parts.push(bytes);
  }
}

// Reads a .spots file. Returns its header and its entries: {atMs, frame}. Throws an Error with a sentence.
export async function read(file) {
  const refuse = (why, next) => { throw new Error(`${file.name}: ${why}; next: ${next}`); };
  if (file.size > FILE_MAX) refuse(`${(file.size / 2 ** 20).toFixed(0)} MB are more than this page reads`, "use 'spots serve' or 'spots export'");
  const frames = new Decoder().feed(new Uint8Array(await file.arrayBuffer()));
  const pieces = [];
  let of = 0;
  for (const { kind, content } of frames) {
    if (kind !== "note" || typeof content.header !== "string") continue;
    pieces[content.i] ??= content.header;
    of = content.of;
  }
  let header = null;
  try {
    if (of && Array.from({ length: of }, (_, i) => pieces[i]).every((one) => one !== undefined)) header = JSON.parse(pieces.join(""));
  } catch { /* damaged: refused below */ }
  if (header === null) refuse("this is no recording, or its start is damaged", "choose a .spots file");
  if (header.recording !== VERSION) refuse(`its format is version ${header.recording}, and this page reads ${VERSION}`, "use the program that wrote it");
  let atMs = 0;
  const entries = [];
  for (const frame of frames) {
    if (frame.kind === "note") atMs = frame.since_us / 1000;
    else entries.push({ atMs, frame });
  }
  return { header, entries };
}
