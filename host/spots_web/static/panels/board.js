// Name and state of the board.
import { list } from "../dom.js";

const WORDS = {
  searching: "searching for a board",
  stalled: "board silent",
  lost: "board lost",
  refused: "another board",
};

export function board(root) {
  const facts = document.getElementById("facts");

  return (state, news) => {
    if (!news.board && !news.connection) return;
    if (document.body.dataset.link !== "live") {
      root.dataset.state = "searching";
      root.textContent = "searching for the server";
      return;
    }
    const it = state.board;
    if (!it) return;
    root.dataset.state = document.body.dataset.board = it.state;
    const words = it.state === "connected" ? `${it.board} on ${it.port}` : WORDS[it.state];
    root.textContent = it.message ? `${words}: ${it.message}` : words;
    list(facts, [
      ["board", it.id],
      ["runtime", it.runtime],
      ["firmware", it.firmware],
      ["calibration", it.id && (it.calibration ?? "none")],
      ["exposure", it.exposure_us && `${it.exposure_us / 1000} ms`],
      ["gain", it.id && `${2 ** (it.gain - 1)}×`],
      ["LED", it.id && (it.led_mA || it.led === "ldr" ? `${it.led_mA} mA` : it.led)],
      ["strain", it.strain_ppm ? `${it.strain_ppm / 10000} %` : null],
    ]);
  };
}
