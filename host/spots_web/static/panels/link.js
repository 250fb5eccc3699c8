// Statistics of the link.
import { list } from "../dom.js";

export function link(root) {
  return (state, news) => {
    const it = news.link;
    if (!it) return;
    list(root, [
      ["rate", it.rate_hz === null ? "–" : `${it.rate_hz.toFixed(1)} Hz`],
      ["latency", it.latency_ms === null ? "–" : `${it.latency_ms.toFixed(1)} ms`],
      ["frames", it.frames.toLocaleString("en")],
      ["lost", it.lost],
      ["bad", it.bad],
    ]);
  };
}
