// The board on USB, by Web Serial: opens a port that the user has permitted, and opens it again when the board
// was unplugged. It runs in the worker, so a hidden tab reads on.

const BAUD = 115200;  // USB ignores it
const SEARCH_MS = 500, HELLO_MS = 2500;
const PROMPT = ">>>", TAIL = 200;  // characters of text in which a prompt is looked for
const LOCK = "spots-usb";  // of the tab that reads the board

const REFUSALS = {
  taken: ["the port cannot be opened", "close the program that uses it, for example 'spots' or an editor, and connect again"],
  tab: ["another tab reads the board", "use that tab, or close it and connect again"],
  prompt: ["the board is at its Python prompt, so its firmware does not run", "press its reset button"],
  silent: ["the device on this port does not answer as a SPOTS board", "choose another port, or flash the board"],
  other: ["this is another board", "plug the previous board in, or connect again"],
};

// `begin(port)` makes and returns the session of an open port; `protocol` is the version that this page reads;
// `say(state, message, next)` shows the state.
export class UsbBoard {
  #stopped = false;
  #writer = null;
  #reader = null;
  #unlock = () => {};
  id = null;

  constructor({ begin, protocol, say }) {
    Object.assign(this, { begin, protocol, say });
  }

  // Reads the board until `stop`. Resolves at the end.
  async run() {
    if (!(await this.#lock())) return this.#refuse("tab");
    this.say("searching", "", "choose the port of the board");
    const wake = () => this.#wake();
    navigator.serial.addEventListener("connect", wake);
    while (!this.#stopped) {
      const [port] = await navigator.serial.getPorts();
      if (port && !(await this.#read(port))) break;
      if (!this.#stopped) await new Promise((done) => { this.#wake = done; setTimeout(done, SEARCH_MS); });
    }
    navigator.serial.removeEventListener("connect", wake);
    this.#unlock();
  }

  #wake = () => {};

  async stop() {
    this.#stopped = true;
    this.#wake();
    await this.session?.commands.command("stream off").catch(() => {});
    await this.#reader?.cancel().catch(() => {});
  }

  // Reads one open port until it ends; returns whether to search again.
  async #read(port) {
    try {
      await port.open({ baudRate: BAUD });
      await port.setSignals({ dataTerminalReady: true });
    } catch {
      // A board that has just been plugged in needs a moment; a port that is in use stays so.
      this.say("refused", ...told("taken"));
      return !this.#stopped;
    }
    this.#writer = port.writable.getWriter();
    this.#reader = port.readable.getReader();
    const session = this.session = this.begin((bytes) => { this.#writer.write(bytes).catch(() => {}); });
    let text = "";
    const reading = (async () => {
      for (;;) {
        const { value, done } = await this.#reader.read();
        if (done) return;
        if (!session.info) text = (text + String.fromCharCode(...value.slice(-TAIL))).slice(-TAIL);
        session.take(value, performance.now());
      }
    })().catch(() => {});
    const found = await Promise.race([this.#identify(session, () => text), reading.then(() => "lost")]);
    if (found === "ready") await reading;
    session.end("the board is disconnected: plug it in again");
    this.session = null;
    await this.#reader.cancel().catch(() => {});
    this.#reader.releaseLock();
    this.#writer.releaseLock();
    await port.close().catch(() => {});
    if (found in REFUSALS) this.#refuse(found);
    else if (found === "protocol") this.say("refused", this.why, "flash the board with the firmware of this version: spots flash");
    else if (!this.#stopped) this.say("lost", "", "plug the board in again, and wait a moment");
    return found === "ready" || found === "lost";
  }

  // Returns "ready", or why this board cannot be read.
  async #identify(session, text) {
    const silent = new Promise((done) => setTimeout(done, HELLO_MS, null));
    const info = await Promise.race([session.commands.command("hello").catch(() => null), silent]);
    if (!info) return text().includes(PROMPT) ? "prompt" : "silent";
    if (info.protocol !== this.protocol) {
      this.why = `the board speaks protocol ${info.protocol}, this page ${this.protocol}`;
      return "protocol";
    }
    if (this.id && info.id !== this.id) return "other";
    this.id = info.id;
    try {
      await session.begin();
    } catch {
      return "lost";
    }
    return "ready";
  }

  #refuse(what) {
    this.say("refused", ...told(what));
  }

  // Only one tab reads the board; the lock ends with the tab.
  #lock() {
    return new Promise((done) => {
      navigator.locks.request(LOCK, { ifAvailable: true }, (lock) => {
        done(lock !== null);
        return lock && new Promise((end) => { this.#unlock = end; });
      });
    });
  }
}

function told(what) {
  const [message, next] = REFUSALS[what];
  return [message, `${message}; next: ${next}`];
}
