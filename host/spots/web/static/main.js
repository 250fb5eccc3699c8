// Takes what the server tells, draws it at the next frame of the screen, and says so.

import { connect } from "./link.js";
import { board } from "./panels/board.js";
import { strip } from "./panels/strip.js";
import { history } from "./panels/history.js";
import { spectrum } from "./panels/spectrum.js";
import { keyboard } from "./panels/keyboard.js";
import { stick } from "./panels/stick.js";
import { twin } from "./panels/twin.js";
import { link } from "./panels/link.js";

// A panel is made once, from its element, and returns what draws it: (state, news, now_s). `state`
// has the newest of every part, `news` the parts that changed since it drew last, and `events`.
const panels = Object.entries({ board, strip, history, spectrum, keyboard, stick, twin, link })
  .map(([name, make]) => make(document.getElementById(name)));

const state = {};
let news = {};

const acknowledge = connect(
  (parts) => {
    const { events, missed, ...changed } = parts;
    Object.assign(state, changed);
    Object.assign(news, changed);
    if (changed.board && changed.board.state !== "connected") letGo();
    if (events) news.events = [...(news.events ?? []), ...events];
  },
  (how) => {
    document.body.dataset.link = how;
    if (how !== "live") letGo();
    news.connection = how;
  },
);

// What is not told any more is not shown as if it were.
function letGo() {
  for (const part of ["touch", "stick", "keys"]) state[part] = news[part] = null;
}

function frame(now_ms) {
  const fresh = news;
  news = {};
  for (const draw of panels) draw(state, fresh, now_ms / 1000);
  acknowledge();
  if (fresh.touch) document.dispatchEvent(new CustomEvent("drawn", { detail: fresh.touch }));
  requestAnimationFrame(frame);
}
requestAnimationFrame(frame);
