// The connection to the server: opened again by itself, and acknowledged only when drawn.

const FIRST_WAIT_MS = 250, LONGEST_WAIT_MS = 5000;

// onNews(parts) for each message, onState("connecting" | "live") as the connection comes and goes.
// Returns a function whose result, called later, acknowledges what had come when it was made.
export function connect(onNews, onState) {
  let socket, wait = FIRST_WAIT_MS, number = 0, acknowledged = 0;

  function open() {
    number = acknowledged = 0;
    socket = new WebSocket(`ws://${location.host}/live`);
    socket.onopen = () => { wait = FIRST_WAIT_MS; onState("live"); };
    socket.onmessage = ({ data }) => {
      const { n, ...parts } = JSON.parse(data);
      number = n;
      onNews(parts);
    };
    socket.onclose = () => {
      onState("connecting");
      // Not all pages at the same moment.
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
