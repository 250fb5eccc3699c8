// Gives a page or a worker `navigator.serial`, whose only port is the board behind the bridge of the tests, see
// bridge.py. Chromium has no way to give a page a port without a person.
{
  const at = (path) => `${self.location.origin}${path}`;
  class Port {
    getInfo() { return { usbVendorId: 0x2e8a, usbProductId: 5 }; }
    async open() {
      const socket = this.socket = new WebSocket(at("/bridge").replace("http", "ws"));
      socket.binaryType = "arraybuffer";
      await new Promise((done, fail) => {
        socket.onopen = done;
        socket.onerror = () => fail(new DOMException("Failed to open serial port.", "NetworkError"));
      });
      this.readable = new ReadableStream({
        start(to) {
          socket.onmessage = ({ data }) => to.enqueue(new Uint8Array(data));
          socket.onclose = () => { try { to.error(new DOMException("The device has been lost.", "NetworkError")); } catch { /* cancelled */ } };
        },
      });
      this.writable = new WritableStream({ write: (bytes) => socket.send(bytes) });
    }
    async setSignals() {}
    async close() { this.socket.close(); }
  }
  const port = new Port(), state = async () => (await fetch(at("/ports"))).json();
  const serial = Object.assign(new EventTarget(), {
    getPorts: async () => ((await state()).permitted ? [port] : []),
    requestPort: async () => { await fetch(at("/permit")); return port; },
  });
  Object.defineProperty(navigator, "serial", { value: serial });
  // The keyboard layout of the visitor: its row of digits types other characters.
  const map = new Map([..."1234567890"].map((one) => [`Digit${one}`, `é${one}`]));
  Object.defineProperty(navigator, "keyboard", { value: { getLayoutMap: async () => map } });
}
