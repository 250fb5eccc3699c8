// The connection of the panels to the worker, in place of that to a server; see the page "Messages of the
// web UI". `ask` sends a request of the page.

const worker = new Worker(new URL("worker.js", import.meta.url), { type: "module" });
const waiting = new Map(), watched = [];
let asked = 0, listener = () => {}, state = () => {};

// Calls onNews(parts) for each message, and onState("live") when the worker runs. Returns a function to
// call when a frame is drawn. It returns a second function, to call when this frame is on the screen.
export function connect(onNews, onState) {
  let number = 0;
  listener = (n, parts) => {
    number = n;
    onNews(parts);
  };
  state = onState;
  return () => {
    const shown = number;
    return () => worker.postMessage({ drawn: shown });
  };
}

// Calls take(value) with each new value of a part, before the panels draw it.
export function onPart(part, take) {
  watched.push([part, take]);
}

// Sends a request to the worker and returns the answer: an object, or {refused: why}.
export function ask(path, body) {
  const id = ++asked;
  worker.postMessage({ id, path, body });
  return new Promise((done) => waiting.set(id, done));
}

// What the worker offers, such as the layouts, when it runs.
export const ready = new Promise((done) => {
  worker.onmessage = ({ data }) => {
    if (data.file) {
      document.dispatchEvent(new CustomEvent("file", { detail: data }));
    } else if (data.report) {
      document.dispatchEvent(new CustomEvent("report", { detail: data.report }));
    } else if (data.ready) {
      state("live");
      done(data.ready);
    } else if (data.answer) {
      waiting.get(data.id)(data.answer);
      waiting.delete(data.id);
    } else {
      for (const [part, take] of watched) if (part in data.parts) take(data.parts[part]);
      listener(data.n, data.parts);
    }
  };
});
