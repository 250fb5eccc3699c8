// The strips of a board that are not shown in detail: picture, numbers, history and state of each strip.
import { make } from "../dom.js";
import { figures } from "./figures.js";
import { history } from "./history.js";
import { sentence } from "./next.js";
import { strip } from "./strip.js";

export function beside(root) {
  let shown = "", strips = [];

  function panel(number) {
    const numbers = make("div", "numbers"), picture = make("div"), past = make("div", "past", make("h2", "", "Last ten seconds"));
    const words = make("p", "remark");
    words.role = "status";
    const one = make("section", "wide touch", make("h2", "strip-name", `Strip ${number}`), numbers, picture, words, past);
    one.ariaLabel = `Strip ${number}`;
    return { number, root: one, words, draws: [figures(numbers), strip(picture), history(past)] };
  }

  return (state, news, now_s) => {
    const { board } = state, all = board?.strips ?? [];
    const others = all.map((_, i) => i).filter((i) => i !== board.strip);
    root.hidden = !others.length;
    root.classList.toggle("first", board?.strip > 0);
    if (others.join() !== shown) {
      shown = others.join();
      strips = others.map(panel);
      root.replaceChildren(...strips.map((one) => one.root));
      news.board = board;
    }
    let more = false;
    for (const { number, words, draws } of strips) {
      const part = (it) => it?.[number] ?? {}, mine = { ...board, ...all[number] };
      const { touch = null, untrusted } = part(state.beside);
      const changes = { touches: news.besides.map((it) => part(it).touch).filter(Boolean) };
      if ("board" in news) changes.board = mine;
      if ("beside" in news) changes.touch = touch;
      for (const draw of draws) more = draw({ board: mine, touch }, changes, now_s) || more;
      const text = sentence(touch, untrusted);
      if (words.textContent !== text) words.textContent = text;
    }
    return more;
  };
}
