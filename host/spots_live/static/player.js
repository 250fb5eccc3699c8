// Plays a recording at its own pace, in place of a board.

export class Player {
  #next = 0;
  #startMs = null;

  // `entries` are those of recording.js; `show(frame, nowMs)` gets each frame.
  constructor(entries, show) {
    Object.assign(this, { entries, show });
  }

  get ended() {
    return this.#next >= this.entries.length;
  }

  tick(nowMs) {
    this.#startMs ??= nowMs - (this.entries[0]?.atMs ?? 0);
    while (!this.ended && this.entries[this.#next].atMs <= nowMs - this.#startMs) this.show(this.entries[this.#next++].frame, nowMs);
  }
}
