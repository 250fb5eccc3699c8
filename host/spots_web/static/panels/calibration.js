// A calibration session by hand: where to press, how steady the press is, faults, and residuals.
// Only a browser with the token has the controls; other browsers only show the session.
import { canvas, colours, fill, make } from "../dom.js";
import { request } from "../request.js";
import { ruler } from "./strip.js";

const KINDS = [
  ["rough", "Rough", "A fingertip and a ruler: 12 presses at most, five minutes."],
  ["fine", "Fine", "An indenter, a ruler and a scale: 45 presses at most; then a finger on three marks."],
  ["rezero", "Re-zero", "Three marks, pressed with what uses the strip: corrects the drift of the calibration."],
];
const PRACTISE = "Practise a calibration: strip, finger, ruler and scale are simulated";
const PRACTISED = { done: "The practice is done", stopped: "The practice is stopped", failed: "The practice has ended early" };
const WAIT = "wait, and do not touch the strip";
const OFFER = "Calibrate the strip by hand";
const OWNED = "The session uses the board: position, keys and controller are shown again when the session ends.";
const AGAIN = "Press the strip: the position of the press is shown below. Another session adds more presses to this calibration.";
const REZEROED = { done: "The board is re-zeroed", stopped: "The re-zero is stopped", failed: "The re-zero has ended early" };
const ENDS = { done: "The board is calibrated", stopped: "The session is stopped", failed: "The session has ended early" };
const N_PER_G = 0.00980665;
// A question may end with the default answer and other answers: (Enter: default; other; other).
const QUESTION = /^(.*?)\s*(?:\(Enter: (.*)\))?\s*:?\s*$/;

export function calibration(root) {
  const opener = document.getElementById("calibrate");
  let it = null, may = false, open = null, question = "", answered = null, step = null;

  // The parts of the panel, in the order of reading.
  const title = make("h2"), count = make("b"), bar = make("progress");
  bar.ariaLabel = "Presses taken";
  const head = make("div", "head", title, count, bar);
  const todo = make("p", "todo"), note = make("p", "note warn"), refused = make("p", "note warn");
  todo.role = "status";
  note.role = refused.role = "alert";
  const aim = make("div", "aim", make("b")), finger = make("div", "finger"), ticks = make("div", "ticks");
  const where = make("div", "where", make("div", "guide", make("div", "along", finger, aim)), ticks);
  where.role = "img";
  const filled = make("i"), steady = make("div", "meter", filled), word = make("span");
  steady.role = "meter";
  steady.ariaLabel = "Steadiness";
  steady.ariaValueMax = "100";
  const hold = make("div", "hold", make("span", "", "steady"), steady, word);
  const reading = make("div", "reading"), drawRuler = canvas(reading, RULER_PX), scale = reading.appendChild(make("b"));
  reading.role = "img";
  const form = make("form", "answer"), buttons = make("div", "buttons");
  const undo = button("Undo the last press", () => send({ do: "undo", step: it.step }));
  const stop = button("Stop", () => send({ do: "cancel" }));
  buttons.append(undo, stop);
  const said = make("ul", "said"), hint = make("p", "note"), watching = make("p", "note",
    "This browser only watches. To take part, open the address with the token that ‘spots serve’ printed.");
  const picture = make("div", "residuals"), paint = residuals(picture);
  const begin = make("form", "begin"), length = make("input");
  length.type = "number";
  length.min = 1; length.max = 1000; length.step = "any"; length.required = true;
  begin.append(make("label", "field", "Length of the strip", make("span", "", length, "mm")));
  for (const [kind, name, text] of KINDS) {
    const one = make("button", "kind", make("b", "", name), make("span", "", text));
    one.value = kind;
    begin.append(one);
  }
  root.append(head, todo, where, hold, note, refused, reading, form, buttons, watching, said, picture, hint, begin);

  async function send(message) {
    for (const one of root.querySelectorAll("button")) one.disabled = true;
    refused.textContent = (await request("calibration", message)).refused ?? "";
    if (refused.textContent) answered = null;
    for (const one of root.querySelectorAll("button")) one.disabled = false;
    refused.hidden = !refused.textContent;
    show();
  }

  function button(name, onClick) {
    const one = make("button", "", name);
    one.type = "button";
    one.addEventListener("click", onClick);
    return one;
  }

  begin.addEventListener("submit", (event) => {
    event.preventDefault();
    send({ do: "start", kind: event.submitter.value, length_mm: Number(length.value) });
  });
  opener.addEventListener("click", () => {
    open = root.hidden;
    show();
  });

  // A question with a default answer gets a field for each value of this answer. An empty field
  // accepts the default value.
  function ask(words, offered) {
    const [usual, ...others] = offered.split("; ");
    const values = [...usual.matchAll(/([\d.,]+)\s*([^\d\s]+)/g)];
    const fields = values.length ? values.map(([, value, unit]) => field(value, unit))
      : words.includes("?") ? [field("", "")] : [];
    const submit = make("button", "main");
    const answer = () => fields.map((one) => one.answer()).filter(Boolean).join(" ");
    const label = () => {
      submit.textContent = answer() ? `Send ${answer()}` : usual ? `Yes: ${usual}` : "Done";
    };
    const reply = (words) => {
      answered = it.step;  // a double click must not send a second answer
      send({ do: "answer", step: answered, text: words });
      show();
    };
    // Each other answer has a button, except `undo`, which has a permanent button.
    const rest = others.filter((one) => one !== "undo").map((one) =>
      button({ again: "Press again" }[one] ?? one, () => reply(one)));
    form.replaceChildren(...fields.map((one) => one.root), submit, ...rest);
    form.oninput = label;
    form.onsubmit = (event) => {
      event.preventDefault();
      reply(answer());
    };
    label();
    // On a phone, focusing a field would open the keyboard, which covers the strip.
    const first = form.querySelector("input");
    (matchMedia("(pointer: coarse)").matches || !first ? submit : first).focus({ preventScroll: true });
  }

  // Shows the simulated ruler and scale. A screen reader gets the numbers.
  function read({ place_um, force_mN }) {
    const grams = force_mN === null ? "" : `${Math.round(force_mN / N_PER_G / 1000)} g`;
    scale.textContent = grams && `scale: ${grams}`;
    reading.firstChild.hidden = place_um === null;
    reading.ariaLabel = [place_um !== null && `ruler: finger at ${mm(place_um)}`, scale.textContent].filter(Boolean).join(", ");
    if (place_um !== null) drawRuler((c, width) => rulerAt(c, width, place_um / 1000), place_um);
  }

  function show() {
    const running = Boolean(it?.running), phase = running ? it.phase : "";
    opener.hidden = !it || running || !may;
    root.hidden = !it || !(running || (open ?? (it.end || (may && (uncalibrated || it.practice)))));
    opener.setAttribute("aria-expanded", String(!root.hidden));
    opener.textContent = !root.hidden ? "close" : it?.practice ? "practise" : "calibrate";
    document.body.dataset.session = running ? "on" : "off";
    if (!it) return;
    const name = it.practice ? "Practice" : "Calibration";
    title.textContent = running && it.title ? `${name}: ${it.title}` : name;
    count.textContent = running && it.total ? `${it.done} of ${it.total}` : "";
    bar.hidden = !count.textContent;
    bar.max = it.total || 1;
    bar.value = it.done || 0;
    const asking = may && phase === "ask" && it.step !== answered;
    const key = asking ? `${it.step}` : "";
    const [, words, offered = ""] = QUESTION.exec(it.todo ?? "");
    form.hidden = !asking;  // before the call of `ask`: a hidden element cannot get the focus
    if (asking && key !== question) ask(words, offered);
    question = key;
    const waits = phase === "work" || it.step === answered || !words;
    put(todo, running ? (waits ? WAIT : words) : ends(it)[it.end] ?? (it.practice ? PRACTISE : OFFER));
    put(note, it.note ?? "");
    where.hidden = !running;
    reading.hidden = !running || !it.ruler;
    if (!reading.hidden) read(it.ruler);
    aim.hidden = !it.at || phase === "release";
    if (it.at) {
      const share = Math.min(it.at.place_um / it.length_um, 1);
      aim.style.left = `${100 * share}%`;
      aim.style.setProperty("--share", share);
      aim.firstChild.textContent = mm(it.at.place_um);
    }
    hold.hidden = phase !== "press";
    buttons.hidden = !running || !may;
    undo.hidden = phase !== "press" || !it.done || it.kind === "rezero";
    begin.lastChild.hidden = !it.rezero;
    watching.hidden = may || !running;
    said.replaceChildren(...(it.said ?? []).filter((text) => text !== it.note).map((text) => make("li", "", text)));
    picture.hidden = !it.fitted;
    if (it.fitted) paint(it.fitted, it.length_um);
    put(hint, running ? OWNED : it.end === "done" && it.kind !== "rezero" && !it.practice ? AGAIN : "");
    begin.hidden = running || !may;
    // At a new step, scroll to the top of the panel.
    if (running && it.step !== step && root.getBoundingClientRect().top < 0) root.scrollIntoView();
    step = it.step;
  }

  let uncalibrated = false, length_um = 0;
  return (state, news) => {
    if ("calibration" in news || "may_command" in news || "board" in news) {
      if (news.calibration) refused.hidden = true;
      it = state.calibration;
      may = Boolean(state.may_command);
      uncalibrated = Boolean(state.board?.id && !state.board.calibration);
      if (it && it.length_um !== length_um) {
        length_um = it.length_um;
        length.value = length_um / 1000;
        ruler(ticks, length_um);
      }
      show();
    }
    if (!it?.running) return;
    const now = state.hold, place_um = now?.place_um ?? null;
    finger.classList.toggle("on", place_um !== null && it.phase === "press");
    if (place_um !== null) finger.style.transform = `translateX(${100 * Math.min(Math.max(place_um / it.length_um, 0), 1)}cqw) scale(0.7)`;
    fill(filled, now?.steady ?? 0);
    steady.ariaValueNow = String(Math.round(100 * (now?.steady ?? 0)));
    put(word, now?.trouble ?? (now ? "hold" : "waiting for a press"));
    where.ariaLabel = [it.at && `Press at ${mm(it.at.place_um)}`, place_um !== null && `finger at about ${mm(place_um)}`].filter(Boolean).join(", ");
  };
}

function ends({ kind, practice }) {
  return practice ? PRACTISED : kind === "rezero" ? REZEROED : ENDS;
}

// Draws the lines of a ruler near a position in mm, and a finger above the position.
const RULER_PX = 84, RULER_MM = 16;
function rulerAt(c, width, place) {
  const begin = Math.max(Math.round(place) - RULER_MM / 2, 0), x = (at) => 12 + ((width - 24) * (at - begin)) / RULER_MM;
  c.strokeStyle = c.fillStyle = colours.text;
  c.lineWidth = 1;
  c.font = "12px -apple-system, 'Segoe UI', Roboto, 'Helvetica Neue', Arial, sans-serif";
  c.textAlign = "center";
  for (let at = begin; at <= begin + RULER_MM; at++) {
    c.beginPath();
    c.moveTo(Math.round(x(at)) + 0.5, 30);
    c.lineTo(Math.round(x(at)) + 0.5, at % 5 ? 48 : 60);
    c.stroke();
    if (at % 5 === 0) c.fillText(`${at}`, x(at), 76);
  }
  c.fillStyle = colours.place;
  c.beginPath();
  c.moveTo(x(place), 30);
  c.lineTo(x(place) - 7, 8);
  c.lineTo(x(place) + 7, 8);
  c.fill();
}

// Shows a text. Screen readers announce a change, so an unchanged text is not set again.
function put(element, text) {
  if (element.textContent !== text) element.textContent = text;
  element.hidden = !text;
}

function mm(um) {
  return `${(um / 1000).toFixed(1)} mm`;
}

// A field for a number with its unit; a force can be typed in grams or newtons.
function field(usual, unit) {
  const input = make("input");
  input.inputMode = unit ? "decimal" : "text";
  input.autocomplete = "off";
  input.placeholder = usual;
  input.ariaLabel = { mm: "Position in mm", g: "Force", N: "Force" }[unit] ?? "Answer";
  const isForce = unit === "g" || unit === "N";
  let chosen = unit;
  const root = make("div", "field", input);
  if (isForce) {
    const units = ["g", "N"].map((one) => {
      const radio = make("input");
      radio.type = "radio";
      radio.name = "unit";
      radio.value = one;
      radio.checked = one === unit;
      radio.addEventListener("change", () => {
        chosen = one;
        const value = Number(usual.replace(",", "."));
        const shown = one === unit ? value : one === "N" ? value * N_PER_G : value / N_PER_G;
        input.placeholder = String(Number(shown.toPrecision(3)));
      });
      return make("label", "unit", radio, make("span", "", one));
    });
    const group = make("div", "units", ...units);
    group.role = "radiogroup";
    group.ariaLabel = "Unit of the force";
    root.append(group);
  } else {
    root.append(make("span", "", unit));
  }
  // A typed unit takes precedence over the chosen unit.
  const answer = () => {
    const text = input.value.trim();
    return text && unit && /\d$/.test(text) ? `${text}${chosen}` : text;
  };
  return { root, answer };
}

// Draws the error of each press as a line from 0: position errors over position, force errors over force.
const HEIGHT = 132, TOP = 24, BOTTOM = 20, FORCES = [0.1, 20];  // px; range of the force axis in N
function residuals(root) {
  const words = make("p", "note");
  const charts = ["Position error of each press", "Force error of each press"].map((name) => {
    const box = make("figure", "", make("figcaption", "", name));
    const draw = canvas(box, HEIGHT);
    box.lastChild.role = "img";
    return { box, draw };
  });
  root.append(words, ...charts.map(({ box }) => box));

  return ({ presses, thin, sigma_um, sigma_share }, length_um) => {
    const places = presses.map(([place, , off]) => [place / length_um, off / 1000, mm(place)]);
    const [low, high] = FORCES.map(Math.log);
    const forces = presses.filter(([, force]) => force > 0).map(([, force, , off]) =>
      [(Math.log(force / 1000) - low) / (high - low), 100 * off, `${(force / 1000).toPrecision(2)} N`]);
    const expected = [`expected error of a position: ${(sigma_um / 1000).toFixed(2)} mm`];
    if (sigma_share !== null) expected.push(`of a force: ${(100 * sigma_share).toFixed(1)} %`);
    words.textContent = [expected.join(", "), ...thin.map((one) => `too few presses ${one}`)].join("; ");
    chart(charts[0], places, sigma_um / 1000, "mm", ["0", mm(length_um)]);
    chart(charts[1], sigma_share === null ? [] : forces, 100 * sigma_share, "%", FORCES.map((one) => `${one} N`));
  };
}

function chart({ box, draw }, points, sigma, unit, ends) {
  box.hidden = !points.length;
  if (box.hidden) return;
  const worst = points.reduce((a, b) => (Math.abs(b[1]) > Math.abs(a[1]) ? b : a));
  const top = 1.15 * Math.max(Math.abs(worst[1]), sigma, 1e-3);
  const digits = top < 0.1 ? 3 : top < 1 ? 2 : 1;
  box.lastChild.ariaLabel = `largest error ${worst[1].toFixed(digits)} ${unit} at ${worst[2]}`;
  draw((c, width) => {
    const half = (HEIGHT - TOP - BOTTOM) / 2, zero = TOP + half, y = (v) => zero - (half * v) / top;
    const x = (share) => 17 + (width - 34) * Math.min(Math.max(share, 0), 1);
    c.fillStyle = colours.faint;
    c.fillRect(0, y(sigma), width, y(-sigma) - y(sigma));
    c.fillStyle = colours.quiet;
    c.fillRect(0, Math.round(zero), width, 1);
    for (const point of points) {
      const [share, off] = point;
      c.strokeStyle = c.fillStyle = unit === "mm" ? colours.place : colours.force;
      c.lineWidth = 2;
      c.beginPath();
      c.moveTo(x(share), zero);
      c.lineTo(x(share), y(off));
      c.stroke();
      c.beginPath();
      c.arc(x(share), y(off), point === worst ? 5 : 3.5, 0, 7);
      c.fill();
    }
    c.font = "12px -apple-system, 'Segoe UI', Roboto, 'Helvetica Neue', Arial, sans-serif";
    c.fillStyle = colours.quiet;
    c.textAlign = "left";
    c.fillText(ends[0], 0, HEIGHT - 4);
    c.fillText(`largest ${worst[1] > 0 ? "+" : "−"}${Math.abs(worst[1]).toFixed(digits)} ${unit} at ${worst[2]}`, 0, 12);
    c.textAlign = "right";
    c.fillText(ends[1], width, HEIGHT - 4);
    c.fillText(`±${top.toFixed(digits)} ${unit}`, width, 12);
  });
}
