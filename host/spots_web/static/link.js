// The connection to the server: reconnects, and acknowledges messages when they are drawn.

const FIRST_WAIT_MS = 250, LONGEST_WAIT_MS = 5000;

// Calls onNews(parts) for each message, and onState("live" | "connecting") when the connection opens
// or closes. Returns a function to call when a frame is drawn. It returns a second function, to call
// when this frame is on the screen: it acknowledges the last message that was drawn.
export function connect(onNews, onState) {
  let socket, wait = FIRST_WAIT_MS, number = 0, acknowledged = 0;

  function open() {
    number = acknowledged = 0;
    // After a proxy that adds encryption: wss.
    socket = new WebSocket(`${location.protocol.replace("http", "ws")}//${location.host}/live`);
    socket.onopen = () => { wait = FIRST_WAIT_MS; onState("live"); };
    socket.onmessage = ({ data }) => {
      const { n, ...parts } = JSON.parse(data);
      number = n;
      onNews(parts);
    };
    socket.onclose = () => {
      onState("connecting");
      // Random, so that not all browsers reconnect at the same time.
      setTimeout(open, wait * (0.75 + Math.random() / 2));
      wait = Math.min(2 * wait, LONGEST_WAIT_MS);
    };
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
