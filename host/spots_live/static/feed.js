// Turns the frames of a board into the parts of the state that the panels show; see the page "Messages
// of the web UI". The server does the same in board_feed.py and strip_feed.py.

const TOUCHING = 1, SATURATED = 2, TOO_DARK = 4, MISFIT = 16, NOT_CALIBRATED = 64, LED_OFF = 128;
const DOUBTFUL = SATURATED | TOO_DARK | MISFIT | NOT_CALIBRATED | LED_OFF, BLIND = NOT_CALIBRATED | LED_OFF;
const ENDED = [3, 4];  // states of the last frame of a contact
const TICK_MS = 500, RATE_OVER_S = 2;
const Q20 = 2 ** 20;

// `put(name, value)` sets a part; `event(object)` adds an event. `words` has the words of the flags and the
// sentences about untrusted readings, `names` those of keys; both are written by spots_live/build.py.
export class Feed {
  #down = new Map();  // places of the pressed keys, by page and usage
  #fingers = [];  // positions in the next reading
  #layout = null;
  #layer = null;
  #arrived = [];  // times of the last readings, in s
  #healthMs = 0;

  constructor(put, event, { words, names }) {
    Object.assign(this, { put, event, words, names });
  }

  // Shows a layout: {shown, places}, as spots_live/build.py writes it, or null if it is unknown.
  use(layout) {
    this.#layout = layout;
    this.#layer = layout && Object.keys(layout.shown.layers)[0];
    this.release();
  }

  // Releases all keys, for example because a frame may be missing.
  release() {
    this.#down.clear();
    for (const name of ["touch", "keys", "untrusted"]) this.put(name, null);
  }

  // Takes a frame of the decoder. `boardS` is its board time in s; `nowMs` the time of its arrival.
  take(frame, boardS, nowMs) {
    if (frame.sensor !== 0) return;
    if (frame.kind === "touch") this.#touch(frame, boardS, nowMs / 1000);
    else if (frame.kind === "spectrum") this.put("spectrum", { counts: frame.counts });
    else if (frame.kind === "contact" && !ENDED.includes(frame.state)) this.#fingers.push(frame.position_um);
    else if (frame.kind === "key") this.#key(frame);
  }

  // Shows rate and losses of the link, twice a second.
  health({ frames, lost, bad }, nowMs) {
    if (nowMs < this.#healthMs) return;
    this.#healthMs = nowMs + TICK_MS;
    while (this.#arrived.length && this.#arrived[0] < nowMs / 1000 - RATE_OVER_S) this.#arrived.shift();
    const { length } = this.#arrived, lastedS = length ? this.#arrived.at(-1) - this.#arrived[0] : 0;
    this.put("link", { rate_hz: lastedS > 0 ? (length - 1) / lastedS : null, frames, lost, bad, latency_ms: null });
  }

  #touch({ flags, contrast_q20, brightness_q20, position_um, force_mN }, timeS, nowS) {
    const touching = (flags & TOUCHING) !== 0, blind = flags & BLIND;
    this.#arrived.push(nowS);
    this.put("touch", {
      time_s: timeS, arrived_s: nowS, touching, trusted: touching && !(flags & DOUBTFUL),
      contrast: contrast_q20 / Q20, brightness: brightness_q20 / Q20,
      position_um: blind || (!touching && !force_mN) ? null : position_um, force_mN: blind ? null : force_mN,
      flags: this.words.flags.filter(([bit]) => flags & bit).map(([, word]) => word), fingers: this.#fingers,
    });
    this.#fingers = [];
    // Without a press, TOO_DARK is always set.
    const known = touching ? flags : flags & ~TOO_DARK, [, why] = this.words.causes.find(([bits]) => (known & bits) === bits) ?? [];
    this.#untrusted(why ?? "", nowS);
  }

  #badSince = null;
  #untrusted(sentence, nowS) {
    if (!sentence) this.#badSince = null;
    else this.#badSince ??= nowS;
    this.put("untrusted", this.#badSince !== null && nowS - this.#badSince > 0.7 ? sentence : "");
  }

  #key({ page, usage, modifiers, pressed }) {
    const id = `${page}/${usage}`;
    if (pressed) this.#down.set(id, this.#place(page, usage, modifiers));
    const [layer, index] = this.#down.get(id) ?? [null, null];
    if (pressed && layer) this.#layer = layer;
    if (!pressed) this.#down.delete(id);
    this.event({ kind: "key", name: this.names[id] ?? `key ${id}`, pressed, layer, index });
    this.put("keys", { layer: this.#layer, down: [...this.#down.values()].map(([layer, index]) => ({ layer, index })) });
  }

  // Returns layer and index of the key that presses a usage, preferably with its modifiers.
  #place(page, usage, modifiers) {
    const found = (this.#layout?.places ?? []).filter((one) => one[0] === page && one[1] === usage);
    const best = found.find((one) => one[2] === modifiers && one[3] === this.#layer) ?? found.find((one) => one[2] === modifiers) ?? found[0];
    return best ? best.slice(3) : [null, null];
  }
}
