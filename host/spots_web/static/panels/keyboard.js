// The keys of the layout, the pressed keys, and the last keys and gestures.
import { make, placed } from "../dom.js";

const SHORTEST_S = 0.15, TAPE = 12;  // shortest highlight of a key; number of keys in the list

export function keyboard(root) {
  const title = root.querySelector("h2");
  const row = root.appendChild(make("div", "keys"));
  const tape = root.appendChild(make("div", "tape"));
  let layout = null, shown = null, keys = [];
  const lit = new Map();  // "layer/index" of a highlighted key -> earliest end of its highlight

  function lay(layer) {
    shown = layer;
    keys = layout.layers[layer].map(({ low, high, label }) => {
      const key = make("div", label.length > 4 ? "key small" : "key", label);
      key.style.left = `calc(${100 * low}% + 2px)`;
      key.style.width = `calc(${100 * (high - low)}% - 4px)`;
      return { low, high, key };
    });
    row.replaceChildren(...keys.map(({ key }) => key));
    title.textContent = Object.keys(layout.layers).length > 1 ? `${layout.name} · ${layer}` : layout.name;
  }

  function say(text, name) {
    tape.append(make("span", name, text));
    while (tape.children.length > TAPE) tape.firstChild.remove();
  }

  return (state, news, now_s) => {
    if (news.board) {
      layout = news.board.layout;
      root.hidden = !layout;
      shown = null;
    }
    if (!layout) return;
    for (const event of news.events) {
      if (event.kind === "gesture") {
        // A tap is not shown as a gesture, because its key is shown.
        if (event.name !== "tap") say(event.name.replaceAll("_", " "), "gesture");
      } else if (event.kind === "key" && event.pressed) {
        say(event.name, "key-event");
        lit.set(`${event.layer}/${event.index}`, now_s + SHORTEST_S);
      }
    }
    const layer = state.keys?.layer in layout.layers ? state.keys.layer : Object.keys(layout.layers)[0];
    if (layer !== shown) lay(layer);
    const down = new Set((state.keys?.down ?? []).map((one) => `${one.layer}/${one.index}`));
    for (const [key, until_s] of lit) if (now_s > until_s) lit.delete(key);
    const touch = state.touch;
    const share = placed(touch) ? touch.position_um / state.board.length_um : -1;
    keys.forEach(({ low, high, key }, i) => {
      const id = `${shown}/${i}`;
      key.classList.toggle("lit", down.has(id) || lit.has(id));
      key.classList.toggle("under", share >= low && share < high);
    });
    return lit.size > 0;  // draw again while a key is highlighted
  };
}
