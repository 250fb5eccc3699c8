// Lists the recordings in the folder, plays one instead of the board, and compares two as curves.
import { button } from "../controls.js";
import { FULL_FORCE_MN, canvas, colours, make } from "../dom.js";
import { request } from "../request.js";

const HEIGHT = 170, TOP = 18, BOTTOM = 18;  // of the chart, in px

export function recordings(root) {
  const opener = document.getElementById("open-recordings");
  const note = make("p", "state"), live = button("Show the board", () => send("live")), list = make("ul", "files");
  note.role = "status";
  const compare = button("Compare", async () => {
    const answer = await send(`compare\n${chosen.join("\n")}`);
    if (answer.curves) draw(answer.curves);
  });
  const legend = make("ul", "key-of"), charts = ["Position, mm", "Force, N"].map((name) => {
    const box = make("figure", "", make("figcaption", "", name));
    box.role = "img";
    return { box, paint: canvas(box, HEIGHT) };
  });
  const curves = make("div", "curves", legend, ...charts.map((one) => one.box));
  curves.hidden = true;
  root.append(make("h2", "", "Recordings"), note, make("div", "buttons foot", live, compare), list, curves);
  let it = null, may = false, open = false, chosen = [], busy = false;

  async function send(body) {
    busy = true;
    show();
    const answer = await request("recording", body);
    note.textContent = answer.refused ?? "";
    busy = false;
    show();
    return answer;
  }

  async function load() {
    const answer = await send("list");
    if (!answer.files) return;
    chosen = chosen.filter((name) => answer.files.some((one) => one.name === name));
    if (!answer.files.length) note.textContent = "the folder has no recordings: record one first";
    list.replaceChildren(...answer.files.map(({ name, bytes, utc_s }) => {
      const play = button("Play", () => send(`play\n${name}`)), box = make("input");
      play.ariaLabel = `Play ${name}`;
      box.type = "checkbox";
      box.ariaLabel = `Compare ${name}`;
      box.checked = chosen.includes(name);
      // At most two recordings are chosen to compare: the last two that were clicked.
      box.addEventListener("change", () => {
        chosen = [...chosen.filter((one) => one !== name), ...(box.checked ? [name] : [])].slice(-2);
        for (const one of list.querySelectorAll("input")) one.checked = chosen.includes(one.value);
        show();
      });
      box.value = name;
      const words = `${new Date(1000 * utc_s).toLocaleString()}, ${(bytes / 1e6).toFixed(2)} MB`;
      return make("li", "", box, make("b", "", name), make("span", "", words), play);
    }));
    show();
  }

  function draw(found) {
    const end_s = Math.max(0.1, ...found.map(({ points }) => points.at(-1)?.[0] ?? 0));
    const high_um = Math.max(1000, ...found.flatMap(({ points }) => points.map((one) => one[1] ?? 0)));
    legend.replaceChildren(...found.map(({ name, cut }, i) => make("li", i ? "" : "place", cut ? `${name} (its beginning)` : name)));
    curves.hidden = false;
    charts.forEach(({ box, paint }, column) => {
      const top = column ? FULL_FORCE_MN : high_um;
      box.ariaLabel = `${box.firstChild.textContent} of ${found.map((one) => one.name).join(" and ")} over time`;
      paint((c, width) => {
        const y = (v) => TOP + (HEIGHT - TOP - BOTTOM) * (1 - Math.min(Math.max(v / top, 0), 1));
        c.strokeStyle = colours.edge;
        c.lineWidth = 1;
        for (const v of [0, top / 2, top]) c.strokeRect(0, Math.round(y(v)) + 0.5, width, 0);
        c.font = "12px -apple-system, 'Segoe UI', Roboto, 'Helvetica Neue', Arial, sans-serif";
        c.fillStyle = colours.quiet;
        c.textAlign = "left";
        c.fillText("0 s", 0, HEIGHT - 3);
        c.fillText((top / 1000).toFixed(0), 0, TOP - 5);
        c.textAlign = "right";
        c.fillText(`${end_s.toFixed(1)} s`, width, HEIGHT - 3);
        c.lineWidth = 1.5;
        found.forEach(({ points }, i) => {
          c.strokeStyle = i ? colours.force : colours.place;
          c.beginPath();
          let drawing = false;
          for (const point of points) {
            const v = point[column + 1];
            if (v !== null) c[drawing ? "lineTo" : "moveTo"]((width * point[0]) / end_s, y(v));
            drawing = v !== null;
          }
          c.stroke();
        });
      });
    });
  }

  opener.addEventListener("click", () => {
    open = !open;
    show();
    if (open) load();
  });

  function show() {
    opener.hidden = !it || !may;
    root.hidden = !it || !may || !open;
    opener.textContent = open ? "close" : "recordings";
    opener.setAttribute("aria-expanded", String(!root.hidden));
    note.hidden = !note.textContent;
    live.disabled = busy || !it?.playing;
    compare.disabled = busy || chosen.length !== 2;
    for (const one of list.querySelectorAll("button")) one.disabled = busy;
  }

  return (state) => {
    const stopped = it?.on && !state.recording?.on;
    it = state.recording;
    may = Boolean(state.may_command);
    show();
    if (stopped && open) load();
  };
}
