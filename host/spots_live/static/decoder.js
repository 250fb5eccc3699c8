// Decodes the bytes of a board to frames, as docs/extend/protocol.md describes them.

const CRC = Array.from({ length: 256 }, (_, n) => {
  for (let bit = 0; bit < 8; bit++) n = n & 1 ? (n >>> 1) ^ 0xedb88320 : n >>> 1;
  return n >>> 0;
});
export const crc32 = (bytes) => ~bytes.reduce((crc, byte) => CRC[(crc ^ byte) & 255] ^ (crc >>> 8), ~0) >>> 0;
const HEADER = 7, LONGEST = 903; // bytes before the body; of the longest frame, without its zero

// Undoes the byte stuffing (COBS) of the bytes before a zero byte; null if they are damaged.
function unstuffed(piece) {
  const out = [];
  for (let at = 0; at < piece.length; ) {
    const length = piece[at];
    if (length === 0 || at + length > piece.length) return null;
    for (let i = at + 1; i < at + length; i++) out.push(piece[i]);
    at += length;
    if (length < 255 && at < piece.length) out.push(0);
  }
  return Uint8Array.from(out);
}

// For each kind of frame: the size of its body, and a function that reads it.
const BODIES = {
  1: [15, (body) => ({
    kind: "touch", flags: body.getUint8(0), contrast_q20: body.getInt32(1, true), brightness_q20: body.getInt32(5, true),
    position_um: body.getInt32(9, true), force_mN: body.getUint16(13, true),
  })],
  2: [43, (body) => ({
    kind: "spectrum", flags: body.getUint8(0), gain: body.getUint8(1),
    counts: [2, 4, 6, 8, 10, 12].map((at) => body.getUint16(at, true)),
    taken_off_q6: [14, 18, 22, 26, 30, 34].map((at) => body.getUint32(at, true)),
    temperature_mC: body.getInt32(38, true), context: body.getUint8(42),
  })],
  4: [5, (body) => ({
    kind: "key", page: body.getUint8(0), usage: body.getUint16(1, true), modifiers: body.getUint8(3), pressed: body.getUint8(4) !== 0,
  })],
  5: [10, (body) => ({
    kind: "contact", id: body.getUint8(0), state: body.getUint8(1), position_um: body.getInt32(2, true),
    sigma_um: body.getUint16(6, true), force_mN: body.getUint16(8, true),
  })],
};
const REST = [...Array(24).fill(0), 0, 0, 0xf0, 0xff, 0]; // what a spectrum of protocol 2 does not have: unknown
const SPECTRUM = 2, TEXT = 3, NOTE = 15; // a note is in recordings only
const READINGS = [1, 2, 5], NUMBERS = 2 ** 16, RECENT = 64, RECENT_LEAST = 8;
const BACK_US = 60_000_000; // a frame may be older than the frame before it, by less than this
const modulo = (us) => (us + 2 ** 32) % 2 ** 32; // the time of a board starts at 0 again
const EMPTY = new TextEncoder().encode("{}");

export class Decoder {
  stats = { frames: 0, lost: 0, bad: 0 }; // frames with a valid CRC; missing numbers; damaged pieces
  #partial = []; // bytes after the last zero byte
  #overlong = false;
  #expected = null; // number of the next frame
  #recent = []; // time and number of the latest readings, which no reply separates
  #lostAtReading = 0;

  // Takes bytes, in any amount, and returns the frames that are now complete.
  feed(bytes) {
    const found = [];
    for (const byte of bytes) {
      if (byte !== 0) {
        if (this.#overlong) continue;
        this.#partial.push(byte);
        if (this.#partial.length > LONGEST) {
          this.#overlong = true;
          this.stats.bad++;
        }
        continue;
      }
      const frame = this.#partial.length && !this.#overlong ? this.#take(this.#partial) : null;
      if (frame) found.push(frame);
      this.#partial = [];
      this.#overlong = false;
    }
    return found;
  }

  #take(piece) {
    const raw = unstuffed(piece), view = raw && new DataView(raw.buffer), size = raw ? raw.length - 4 : 0;
    if (size < HEADER || crc32(raw.subarray(0, size)) !== view.getUint32(size, true)) {
      this.stats.bad++;
      return null;
    }
    const kind = raw[0] & 15, sequence = view.getUint16(1, true), t_us = view.getUint32(3, true);
    let body = raw.subarray(HEADER, size);
    if (kind === NOTE) return this.#object({ kind: "note", since_us: sequence * 2 ** 32 + t_us }, body.length ? body : EMPTY);
    this.#count(kind, sequence, t_us);
    const head = { sensor: raw[0] >> 4, sequence, t_us }, [bodySize, read] = BODIES[kind] ?? [];
    if (kind === TEXT) return this.#object({ ...head, kind: "text" }, body);
    if (!read) return null; // a kind of a later version
    if (kind === SPECTRUM && body.length + REST.length === bodySize) body = Uint8Array.of(...body, ...REST);
    if (body.length === bodySize) return { ...head, ...read(new DataView(body.buffer, body.byteOffset, bodySize)) };
    this.stats.bad++;
    return null;
  }

  #object(head, body) {
    try {
      const content = JSON.parse(new TextDecoder("utf-8", { fatal: true }).decode(body));
      if (content && typeof content === "object" && !Array.isArray(content)) return { ...head, content };
    } catch { /* no JSON */ }
    this.stats.bad++;
    return null;
  }

  // Drops the losses since the last reading: a restarted board sends no readings, and counts from 0 again.
  restarted() {
    this.stats.lost = Math.min(this.stats.lost, this.#lostAtReading);
    this.#recent = [];
  }

  #count(kind, sequence, t_us) {
    const gap = this.#expected === null ? 0 : (sequence - this.#expected) & 0xffff;
    // The number gives the loss modulo 2 ** 16, the time the rest. A repeated frame, or a restart, gives less than 0.
    const usual = gap && kind !== TEXT ? this.#usual(t_us) : 0;
    this.stats.lost += Math.max(0, gap + NUMBERS * Math.ceil((usual - gap) / NUMBERS - 0.5));
    this.#expected = (sequence + 1) & 0xffff;
    this.stats.frames++;
    if (kind === TEXT) this.#recent = []; // the streams may have changed
    if (!READINGS.includes(kind)) return;
    this.#lostAtReading = this.stats.lost;
    this.#recent.push([t_us, this.stats.frames + this.stats.lost]);
    if (this.#recent.length > RECENT) this.#recent.shift();
  }

  // Returns how many frames the board usually sends from the last reading until a time.
  #usual(t_us) {
    if (this.#recent.length < RECENT_LEAST) return 0;
    const [firstUs, first] = this.#recent[0], [lastUs, last] = this.#recent.at(-1);
    return (modulo(t_us - lastUs + BACK_US) - BACK_US) * (last - first) / Math.max(1, modulo(lastUs - firstUs));
  }
}
