// Commands to a board and their replies; see the page "Commands of a board".
import { crc32 } from "./decoder.js";

const REPLY_MS = 4000, LONG_MS = { autoexpose: 120_000, dark: 30_000, save: 10_000 };
const COUNTERS = /^(cal|layout) (?!begin|end|clear|lines)/;  // a line of an upload

// Sends commands one by one. `send(bytes)` writes to the board; pass each TEXT frame to `take`.
export class Commands {
  #waiting = [];  // {line, done, fail}; the first one is sent
  #timer = 0;

  constructor(send) {
    this.send = send;
  }

  // Sends a command, and returns its reply. Rejects with a sentence if the board refuses it or is silent.
  command(line) {
    return new Promise((done, fail) => {
      this.#waiting.push({ line, done, fail });
      if (this.#waiting.length === 1) this.#next();
    });
  }

  // Uploads a calibration (`cal`) or a key layout (`layout`). An invalid one changes nothing.
  async upload(kind, lines) {
    await this.command(`${kind} begin`);
    for (const line of lines) await this.command(`${kind} ${line}`);
    return this.command(`${kind} end ${checksum(lines)}`);
  }

  // Takes the content of a TEXT frame.
  take(content) {
    const first = this.#waiting[0];
    if (!content.re || !first || content.re !== first.line.split(" ")[0]) return;
    if (content.error) this.#finish((one) => one.fail(new Error(`the board refuses '${short(one.line)}': ${content.error}`)));
    else this.#finish((one) => one.done(content));
  }

  // Rejects all commands that wait, for example because the board is disconnected.
  abandon(why) {
    clearTimeout(this.#timer);
    for (const one of this.#waiting.splice(0)) one.fail(new Error(why));
  }

  #finish(how) {
    clearTimeout(this.#timer);
    how(this.#waiting.shift());
    if (this.#waiting.length) this.#next();
  }

  #next() {
    const { line } = this.#waiting[0];
    this.send(new TextEncoder().encode(`${line}\n`));
    this.#timer = setTimeout(
      () => this.#finish((one) => one.fail(new Error(`the board does not answer '${short(one.line)}': plug it in again`))),
      LONG_MS[line.split(" ")[0]] ?? REPLY_MS,
    );
  }
}

// Checksum of the lines of an upload, each ended by LF.
export function checksum(lines) {
  return crc32(new TextEncoder().encode(lines.map((line) => `${line}\n`).join(""))).toString(16).padStart(8, "0");
}

function short(line) {
  return COUNTERS.test(line) ? line.split(" ").slice(0, 2).join(" ") : line;
}
