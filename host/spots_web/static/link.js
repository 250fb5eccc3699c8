// The connection to the server: reconnects, and acknowledges messages when they are drawn.

const FIRST_WAIT_MS = 250, LONGEST_WAIT_MS = 5000;
// Time without a message after which the server does not answer: it sends at least one a second.
const SILENT_MS = 2900;

// Calls onNews(parts) for each message, and onState("live" | "connecting") when the connection opens
// or closes. Returns a function to call when a frame is drawn. It returns a second function, to call
// when this frame is on the screen: it acknowledges the last message that was drawn.
export function connect(onNews, onState) {
  let socket, wait = FIRST_WAIT_MS, number = 0, acknowledged = 0, silent = 0;

  function open() {
    number = acknowledged = 0;
    // Relative, because a proxy may serve the page below a path. After a proxy that adds encryption: wss.
    const address = new URL("live", document.baseURI);
    address.protocol = address.protocol.replace("http", "ws");
    socket = new WebSocket(address);
    socket.onopen = () => { wait = FIRST_WAIT_MS; listen(); onState("live"); };
    socket.onmessage = ({ data }) => {
      listen();
      const { n, ...parts } = JSON.parse(data);
      number = n;
      if (Object.keys(parts).length) onNews(parts);
    };
    socket.onclose = closed;
    listen();
  }

  // The network may lose a connection without closing it. A message waits while this script is busy,
  // so those that have arrived are handled before the connection is given up.
  function listen() {
    clearTimeout(silent);
    silent = setTimeout(() => { silent = setTimeout(giveUp); }, SILENT_MS);
  }

  function giveUp() {
    socket.onopen = socket.onmessage = socket.onclose = null;
    socket.close();
    closed();
  }

  function closed() {
    clearTimeout(silent);
    onState("connecting");
    // Random, so that not all browsers reconnect at the same time.
    setTimeout(open, wait * (0.75 + Math.random() / 2));
    wait = Math.min(2 * wait, LONGEST_WAIT_MS);
  }

  open();
  return () => {
    const drawn = number, on = socket;
    return () => {
      if (drawn > acknowledged && on === socket && socket.readyState === WebSocket.OPEN) {
        socket.send(String(drawn));
        acknowledged = drawn;
      }
    };
  };
}
