// A connected board: decodes its bytes, sends it commands, and shows its readings.
import { Commands } from "./commands.js";
import { Decoder } from "./decoder.js";
import { Feed } from "./feed.js";

const STREAMS = "stream contact touch spectrum";
const STALLED_MS = 500, ASK_MS = 1000;  // without a frame: until the board counts as silent; between two queries
const WRAP_US = 2 ** 32, DARK_SAMPLES = 64;
const BACK_US = 1_000_000;  // the clock of a restarted board goes back by more
const NEXT_STALLED = "the board sends no readings; next: wait a moment, or press the board's reset button";

// Unwraps the board time of frames, which has 32 bits.
export class Unwrapped {
  lastUs = null;

  us(t_us) {
    if (this.lastUs === null) this.lastUs = t_us;
    const step = ((t_us - this.lastUs) % WRAP_US + WRAP_US) % WRAP_US;
    return this.lastUs += step < WRAP_US / 2 ? step : step - WRAP_US;
  }
}

// `send(bytes)` writes to the port `name`. `page` has `put` and `event`, see feed.js. `words` and `layouts` are
// those of spots_live/build.py. `expected` is that of the part `board`, or null if it is unknown.
export class Session {
  decoder = new Decoder();
  info = null;
  tap = null;  // gets all bytes, while they are recorded
  #clock = new Unwrapped();
  #heardMs = 0;
  #askedMs = 0;
  #state = "";

  constructor({ send, name, page, words, layouts, expected = null }) {
    Object.assign(this, { name, page, layouts, expected });
    this.commands = new Commands(send);
    this.feed = new Feed(page.put, page.event, words);
  }

  // Identifies the board, and starts its streams.
  async begin() {
    const info = await this.commands.command("hello"), { dark, full_scale } = await this.commands.command("get");
    this.info = info;
    this.dark = dark;
    const layout = info.layout === null ? this.layouts.digits : Object.values(this.layouts).find((one) => one.checksum === info.layout) ?? null;
    this.feed.use(layout);
    const { id, calibration, length_um, relative_force } = info;
    this.known = {
      ...info, full_scale, port: this.name, strip: 0, strips: [{ id, calibration, length_um, relative_force }], start: (info.boot ?? []).join("; "),
      expected: this.expected && { ...this.expected, dark: dark.map((sum) => sum / DARK_SAMPLES) }, layout: length_um ? layout?.shown ?? null : null,
    };
    await this.commands.command(STREAMS);
    this.#heardMs = performance.now();
    this.say("connected");
  }

  // Shows the state of the board.
  say(state, message = "", next = "") {
    this.#state = state;
    this.page.put("board", { state, message, next, ...this.known });
  }

  take(bytes, nowMs) {
    this.tap?.(bytes, nowMs);
    for (const frame of this.decoder.feed(bytes)) this.show(frame, nowMs);
  }

  show(frame, nowMs) {
    this.#heardMs = nowMs;
    if (this.#state === "stalled" && frame.kind === "touch") this.say("connected");
    const beforeUs = this.#clock.lastUs, us = this.#clock.us(frame.t_us);
    if (frame.kind !== "text") return this.feed.take(frame, 1e-6 * us, nowMs);
    if (us < beforeUs - BACK_US) this.decoder.restarted();
    this.commands.take(frame.content);
  }

  // Call this regularly: shows the health of the link; starts the streams of a silent board again.
  tick(nowMs) {
    this.feed.health(this.decoder.stats, nowMs);
    const everyMs = this.info ? 1e-3 * this.info.exposure_us * this.info.average : 0;
    if (!this.#state || nowMs - this.#heardMs < Math.max(STALLED_MS, 3 * everyMs)) return;
    if (this.#state === "connected") {
      this.feed.release();
      this.say("stalled", "", NEXT_STALLED);
    }
    if (this.#state === "stalled" && nowMs - this.#askedMs > ASK_MS) {
      this.#askedMs = nowMs;
      this.begin().catch(() => {});
    }
  }

  // Ends the session: what waits for a reply is refused.
  end(why) {
    this.commands.abandon(why);
    this.feed.release();
    this.page.put("stick", null);
  }
}
