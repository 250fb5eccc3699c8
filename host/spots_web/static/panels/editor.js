// The layout editor: zones over the live strip, their actions, and the button that stores them.
// Only a browser with the token shows the editor; the server checks and stores each layout.
import { button, field, number, put, sliderField, text } from "../controls.js";
import { canvas, colours, make, placed } from "../dom.js";
import { editing, listed } from "../editing.js";
import { actionField, cap, capOfText, matches, missing, readUsages } from "../layout/actions.js";
import * as file from "../layout/file.js";
import { request } from "../request.js";
import { holdRule, tables } from "./behaviours.js";

// Length of a strip without a calibration; steps of a border with the arrow keys; keys of the draft that
// are shown.
const USUAL_LENGTH_UM = 85000, STEP_MM = 0.5, FINE_MM = 0.1, TRIED = 8;
// The chart of the force: the time that it shows, number of stored points, height in px.
const FORCE_S = 4, FORCE_KEPT = 512, FORCE_HEIGHT = 130;
const TUNING = {
  detect: ["Number of readings that make a press", ""], flavor: ["A hold is decided", ""],
  press_mN: ["Force that begins a touch", "mN"], release_mN: ["Force that ends a touch", "mN"],
  firm_mN: ["Force of a firm press", "mN"], firm_ms: ["Time for a firm press", "ms"],
  require_prior_idle_ms: ["Taps only after another key, within", "ms"], release_after_ms: ["A sticky key ends after", "ms"],
  tapping_term_ms: ["A longer touch is a hold", "ms"], double_ms: ["Longest pause of a double tap", "ms"],
  quick_tap_ms: ["Time from a tap to a held tap", "ms"], slack_um: ["Position tolerance of a repeated tap", "µm"],
  slide_um: ["Step of a slide", "µm"], swipe_um: ["Least length of a swipe", "µm"],
  swipe_ms: ["Longest time of a swipe", "ms"], release_ms: ["Release debounce", "ms"],
  tap_ms: ["Least time of a tapped key", "ms"], caps_lock_ms: ["Least time of caps lock", "ms"],
  text_ms: ["Time of each key of a text", "ms"],
  jump_um: ["Longest jump of a finger", "µm"], stuck_ms: ["A touch is an object, not a finger, after", "ms"],
};
const STORED = {
  this: "on the board", default: "not on the board: it has its default layout",
  other: "not on the board: it has another layout", null: "no board is connected",
};

// The computer that a layout is made for, as a text.
const computerOf = ({ host = "", os = "" }) => `${host} ${os}`;

export function editor(root) {
  const clearer = document.getElementById("clear");
  let usages = [], state = null, known = null, length_um = USUAL_LENGTH_UM, layer = 0, zone = 0, dragging = false;
  let drawn = { layer: "", zones: [] };
  const engine = editing(root, document.getElementById("edit"), {
    path: "layout", store: "push", words: { push: "Put on the board", chooser: "Layout file to import" },
    state: (it, changed, loses) => (it.stored === null ? STORED.null
      : changed ? `not on the board yet${loses.length ? `; nothing will type ${listed(loses)}` : ""}` : STORED[it.stored] ?? ""),
    paused: () => dragging, refresh, first: layTuning,
    checked: ({ problems = [] }) => {
      never.hidden = !problems.length;
      never.replaceChildren(...problems.map((one) => make("li", "", one)));
    },
    shown: (it, may, busy) => {
      clearer.hidden = !may || !["this", "other"].includes(it.stored);
      clearer.disabled = busy;
    },
  });
  const { draft } = engine, never = make("ul", "never");
  never.ariaLabel = "What can never be typed";
  never.hidden = true;

  // The parts of the panel, in the order of reading.
  const title = make("h2", "", "Key layout"), name = text("Name of the layout");
  const head = make("div", "head", title, name, engine.undo, engine.redo);
  const computer = ["host", "os"].map((part) => {
    const choice = make("select");
    choice.ariaLabel = part === "host" ? "Keyboard layout of your computer" : "Operating system";
    choice.addEventListener("change", () => edit((_, content) => {
      if (choice.value) content[part] = choice.value;
      else delete content[part];
    }));
    return [part, choice];
  });
  const tabs = make("div", "tabs"), addLayer = button("Add a layer", newLayer);
  tabs.setAttribute("role", "group");
  tabs.ariaLabel = "Layers";
  const finger = make("div", "finger"), row = make("div", "zones", finger);
  row.setAttribute("role", "group");
  row.ariaLabel = "Zones of the strip, from the sensor's end";
  const place = make("p", "place");
  const label = text("Text on the key"), width = number("Width, mm");
  width.min = 0.1;
  const zoneButtons = make("div", "buttons",
    button("Add a zone", () => edit((it) => { it.keys.splice(++zone, 0, {}); file.change(it, zone, { width: file.table(it.keys[zone - 1]).width }); })),
    button("Split", () => edit((it) => file.split(it, zone))),
    button("Equal widths", () => edit((it) => it.keys.forEach((_, i) => file.change(it, i, { width: 1 })))),
    button("Remove the zone", () => edit((it) => { it.keys.splice(zone, 1); zone = Math.max(zone - 1, 0); })));
  const removeZone = zoneButtons.lastChild;
  // The characters that the computer of the draft types; null until the server has sent them.
  const types = () => (known && draft.value && known.of === computerOf(draft.value.content) ? known.characters : null);
  async function loadCharacters({ host, os }) {
    const of = computerOf({ host, os });
    if (known?.of === of) return;
    known = { of, characters: null, caps: null };
    const { characters, caps } = await request("layout", { do: "characters", host, os });
    if (known.of !== of) return;
    known = characters === undefined ? null : { of, characters: new Set(characters), caps };
    engine.draw();
    markText();
  }
  // The characters on the keys of this computer; null without a host, and until the server has sent them.
  const caps = () => (draft.value?.content.host && types() ? known.caps : null);
  const find = (typed) => matches(usages, draft.value.content, typed, types());
  // A tap, a text and a macro exclude each other.
  const instead = (slot) => (slot === "tap" ? { text: "", macro: undefined } : {});
  const actions = Object.entries(file.SLOTS).map(([slot, words]) =>
    [slot, actionField(words, find, (value) => edit((it) => file.change(it, zone, { ...instead(slot), [slot]: value })))]);
  const typedText = make("textarea"), textNote = make("p", "place");
  typedText.ariaLabel = "Text that a tap types";
  typedText.rows = 2;
  typedText.spellcheck = false;
  textNote.role = "status";
  typedText.addEventListener("input", () => markText());
  typedText.addEventListener("change", () => edit((it) => file.change(it, zone, { text: typedText.value, ...(typedText.value && { tap: "", macro: undefined }) })));
  // Marks what the computer cannot type, while somebody writes.
  function markText() {
    const none = missing(typedText.value, types()), macro = file.table(draft.value?.content.layer[layer].keys[zone] ?? {}).macro;
    typedText.setAttribute("aria-invalid", String(none.length > 0));
    const host = draft.value?.content.host;
    const words = none.length ? `${host ? `the host ${host} does not type` : "choose the layout of your computer for"}: ${none.join(" ")}` : "";
    const note = words || (macro ? `macro: ${macro.join(", ")}` : "");
    if (textNote.textContent !== note) textNote.textContent = note;
  }
  const rule = holdRule((parts) => edit((it) => file.change(it, zone, parts)));
  const ofZone = make("fieldset", "zone-form", make("legend"), make("div", "fields", field(label), field(width)),
    make("div", "fields", ...actions.map(([, one]) => one.root)), field(typedText), textNote, rule.root, zoneButtons);
  const named = tables((mutate) => edit((_, content) => mutate(content)), find);
  const layerName = text("Name of the layer"), gap = number("Gap, % of a key");
  gap.min = 0; gap.max = 80;
  const swipes = Object.entries(file.SWIPES).map(([slot, words]) =>
    [slot, actionField(words, find, (value) => edit((it) => { if (value) it[slot] = value; else delete it[slot]; }))]);
  const removeLayer = button("Remove the layer", () => {
    const value = draft.value, at = layer;
    layer = zone = 0;
    file.renameLayer(value.content, at, "");
    draft.set(value);
  });
  const ofLayer = make("fieldset", "layer-form", make("legend"),
    make("div", "fields", field(layerName), field(gap), ...swipes.map(([, one]) => one.root)), make("div", "buttons", removeLayer));
  const tuning = make("details", "tuning", make("summary", "", "Tuning"), make("div", "fields"));
  const trial = make("div", "trial"), trialWords = make("p", "place"), points = [];
  const force = make("figure", "", make("figcaption", "", "Force of the last seconds, with the force and time limits of this draft")), paintForce = canvas(force, FORCE_HEIGHT);
  force.role = "img";
  force.ariaLabel = "Force of the last seconds, with the force and time limits of this draft";
  tuning.firstChild.after(force);
  engine.foot.firstChild.after(button("New", () => { layer = zone = 0; draft.set({ content: file.empty(), text: "" }); }));
  root.append(head, make("div", "layers-row", tabs, addLayer), row, place, make("div", "tries", trialWords, trial), engine.state, never, engine.foot, ofZone, ofLayer, make("div", "fields", ...computer.map(([, one]) => field(one))), named.root, tuning, engine.ask);

  // Changes the shown layer in the draft; for `replace` see `edit` in `editing`.
  function edit(mutate, replace) {
    engine.edit((content) => mutate(content.layer[layer], content), replace);
  }
  function newLayer() {
    edit((_, content) => {
      const names = content.layer.map((one) => one.name);
      let i = names.length + 1;
      while (names.includes(`layer${i}`)) i++;
      content.layer.push({ name: `layer${i}`, keys: [{}] });
      layer = content.layer.length - 1;
      zone = 0;
    });
  }

  name.addEventListener("change", () => edit((_, content) => { content.name = name.value; }));
  label.addEventListener("change", () => edit((it) => file.change(it, zone, { label: label.value })));
  width.addEventListener("change", () => edit((it) => {
    const all = file.zones(it), share = Number(width.value) * 1000 / length_um;
    // The widths of the other zones keep their proportions.
    const rest = 1 - (all[zone].high - all[zone].low);
    if (!(share > 0 && share < 1) || !rest) return;
    const units = all.reduce((sum, { key }, i) => (i === zone ? sum : sum + (key.width ?? 1)), 0);
    file.change(it, zone, { width: Number((units * share / (1 - share)).toFixed(4)) });
  }));
  layerName.addEventListener("change", () => {
    const value = draft.value, wanted = layerName.value.trim();
    if (wanted && !value.content.layer.some((one) => one.name === wanted)) file.renameLayer(value.content, layer, wanted);
    draft.set(value);
    engine.draw();
  });
  gap.addEventListener("change", () => edit((it) => {
    if (Number(gap.value)) it.gap_percent = Number(gap.value);
    else delete it.gap_percent;
  }));
  clearer.addEventListener("click", async () => {
    const { refused } = await engine.post({ do: "clear" });
    if (refused) {
      engine.setOpen(true);
      engine.fail(refused);
    } else engine.say("the board has its default layout again; ‘Put on the board’ restores yours");
  });

  // Zones and borders. Tab reaches the chosen zone and its borders; arrows choose and move.
  const zoneElements = [], borders = [];
  function zoneElement(i) {
    return zoneElements[i] ??= (() => {
      const one = make("button", "zone", make("b"), make("small"));
      one.type = "button";
      one.addEventListener("click", () => { zone = i; engine.draw(); });
      one.addEventListener("keydown", (event) => {
        const to = { ArrowLeft: i - 1, ArrowRight: i + 1, Home: 0, End: draft.value.content.layer[layer].keys.length - 1 }[event.key];
        if (to === undefined || !zoneElements[to]?.isConnected) return;
        event.preventDefault();
        zone = to;
        engine.draw();
        zoneElements[to].focus();
      });
      return one;
    })();
  }
  function border(i) {
    return borders[i] ??= (() => {
      const one = make("div", "border");
      one.setAttribute("role", "separator");
      one.ariaOrientation = "vertical";
      const move = (share, replace) => edit((it) => file.moveBorder(it, i, share), replace);
      one.addEventListener("pointerdown", (event) => {
        event.preventDefault();
        one.focus();
        one.setPointerCapture(event.pointerId);
        const box = row.getBoundingClientRect();
        dragging = false;
        one.onpointermove = (moved) => {
          move((moved.clientX - box.left) / box.width, dragging);
          dragging = true;
        };
      });
      for (const end of ["pointerup", "pointercancel", "lostpointercapture"]) {
        one.addEventListener(end, () => { one.onpointermove = null; dragging = false; engine.check(); });
      }
      one.addEventListener("keydown", (event) => {
        const way = { ArrowLeft: -1, ArrowRight: 1 }[event.key];
        if (!way) return;
        event.preventDefault();
        const at = file.zones(draft.value.content.layer[layer])[i].high;
        move(at + way * (event.shiftKey ? FINE_MM : STEP_MM) * 1000 / length_um, false);
      });
      return one;
    })();
  }

  function words(key) {
    const written = [key.tap, key.firm, key.hold].filter(Boolean).map((action) => cap(usages, action, caps()));
    if (key.text) written.unshift(capOfText(key.text));
    if (key.macro) written.unshift("macro");
    const characters = written.filter((one) => [...one].length === 1);
    return key.label ?? (characters.length > 1 ? characters.join(" ") : written[0] ?? "");
  }

  // Shows the draft.
  function refresh({ content }) {
    load();
    layer = Math.min(layer, content.layer.length - 1);
    const now = content.layer[layer], all = file.zones(now);
    drawn = { layer: now.name, zones: all };
    zone = Math.min(zone, all.length - 1);
    put(name, content.name);
    while (tabs.children.length > content.layer.length) tabs.lastChild.remove();
    content.layer.forEach((one, i) => {
      const tab = tabs.children[i] ?? tabs.appendChild(button("", () => { layer = i; zone = 0; engine.draw(); }));
      tab.textContent = one.name;
      tab.setAttribute("aria-pressed", String(i === layer));
    });
    const children = [finger];
    all.forEach(({ key, low, high }, i) => {
      const one = zoneElement(i), gap = (now.gap_percent ?? 0) / 200 * (high - low);
      one.style.left = `calc(${100 * (low + (i ? gap : 0))}% + 1px)`;
      one.style.width = `calc(${100 * (high - low - (i ? gap : 0) - (i + 1 < all.length ? gap : 0))}% - 2px)`;
      one.children[0].textContent = words(key) || "·";
      one.classList.toggle("characters", /^\S( \S)+$/.test(words(key)));
      one.children[1].textContent = ["double", "hold", "firm", "slide_minus", "slide_plus"].filter((slot) => key[slot]).length || "";
      one.tabIndex = i === zone ? 0 : -1;
      one.setAttribute("aria-pressed", String(i === zone));
      one.ariaLabel = `Zone ${i + 1}: ${words(key) || "no action"}, ${mm(low)} to ${mm(high)}`;
      children.push(one);
      if (i + 1 === all.length) return;
      const line = border(i);
      line.style.left = `${100 * high}%`;
      line.tabIndex = i === zone || i === zone - 1 ? 0 : -1;
      line.ariaLabel = `Border between zones ${i + 1} and ${i + 2}`;
      line.ariaValueMin = ((low * length_um) / 1000).toFixed(1);
      line.ariaValueMax = ((all[i + 1].high * length_um) / 1000).toFixed(1);
      line.ariaValueNow = ((high * length_um) / 1000).toFixed(1);
      line.ariaValueText = mm(high);
      children.push(line);
    });
    if (children.length !== row.children.length || children.some((one, i) => one !== row.children[i])) row.replaceChildren(...children);
    const { key, low, high } = all[zone];
    ofZone.firstChild.textContent = `Zone ${zone + 1} of ${all.length}, ${mm(low)} to ${mm(high)}`;
    put(label, key.label ?? "");
    label.placeholder = words({ ...key, label: undefined });
    put(width, (((high - low) * length_um) / 1000).toFixed(2));
    width.disabled = removeZone.disabled = all.length === 1;
    for (const [slot, one] of actions) one.show(key[slot] ?? "", usages.length);
    loadCharacters(content);
    put(typedText, key.text ?? "");
    markText();
    for (const [part, choice] of computer) {
      const options = state ? ["", ...(part === "host" ? state.hosts : state.systems)] : [""];
      if (choice.options.length !== options.length) choice.replaceChildren(...options.map((one) => new Option(one || "not given", one)));
      choice.value = content[part] ?? "";
    }
    if (state) rule.show(key, content, state);
    if (state) named.show(content, usages.length, state);
    ofLayer.firstChild.textContent = `Layer ${now.name}`;
    put(layerName, now.name);
    put(gap, String(now.gap_percent ?? 0));
    for (const [slot, one] of swipes) one.show(now[slot] ?? "", usages.length);
    removeLayer.disabled = content.layer.length === 1;
    for (const [statement, { show }] of Object.entries(tunings)) show(content.tuning?.[statement]);
  }

  // The fields of [tuning], with the limits that the server sends.
  let tunings = {};
  function layTuning(it) {
    state = it;
    tunings = Object.fromEntries(Object.entries(it.limits).map(([statement, [low, high, usual]]) => {
      const [words, unit] = TUNING[statement] ?? [statement, ""];
      const set = (value, replace) => edit((_, content) => {
        const values = { ...content.tuning, [statement]: value };
        if (value === undefined) delete values[statement];
        if (Object.keys(values).length) content.tuning = values;
        else delete content.tuning;
      }, replace);
      if (statement === "flavor") {
        const choice = make("select", "", ...it.flavors.map((one) => new Option(one)));
        choice.addEventListener("change", () => set(choice.value === it.flavors[usual] ? undefined : choice.value));
        return [statement, { root: make("label", "", make("span", "", words), choice), show: (value) => { choice.value = value ?? it.flavors[usual]; } }];
      }
      const sizes = { low, high, top: usual ? 4 * usual : 4000, step: usual > 1000 ? 50 : usual > 20 ? 5 : 1 };
      const one = sliderField(words, unit, sizes, (value, replace) => set(value === usual ? undefined : value, replace));
      return [statement, { ...one, show: (value) => one.show(value ?? usual) }];
    }));
    tuning.lastChild.replaceChildren(...Object.values(tunings).map((one) => one.root));
  }

  function mm(share) {
    return `${((share * length_um) / 1000).toFixed(1)} mm`;
  }

  // The force of the finger, and the forces and times that the draft compares it with.
  function drawForce(limits) {
    const tuned = (name) => draft.value.content.tuning?.[name] ?? limits[name][2];
    const lines = ["press_mN", "release_mN", "firm_mN"].map((name) => [TUNING[name][0], tuned(name)]).filter(([, mN]) => mN);
    const times = ["tapping_term_ms", "firm_ms"].map((name) => [TUNING[name][0], tuned(name)]);
    paintForce((c, width) => {
      const top = Math.max(1000, ...lines.map(([, mN]) => 1.15 * mN), ...points.map(([, mN]) => mN));
      const y = (mN) => FORCE_HEIGHT - 4 - (FORCE_HEIGHT - 20) * (mN / top), end_s = points.at(-1)?.[0] ?? 0;
      const x = (time_s) => width * (1 - (end_s - time_s) / FORCE_S);
      c.font = "12px -apple-system, 'Segoe UI', Roboto, 'Helvetica Neue', Arial, sans-serif";
      c.lineWidth = 1;
      c.strokeStyle = colours.quiet;
      c.fillStyle = colours.quiet;
      for (const [text, mN] of lines) {
        c.beginPath();
        c.moveTo(0, Math.round(y(mN)) + 0.5);
        c.lineTo(width, Math.round(y(mN)) + 0.5);
        c.stroke();
        c.fillText(`${text}, ${mN} mN`, 4, y(mN) - 3);
      }
      // The times of the draft begin at the start of the last touch.
      const from = points.findLastIndex(([, mN], i) => mN && !points[i - 1]?.[1]);
      if (from >= 0) for (const [text, ms] of times) {
        const at = x(points[from][0] + ms / 1000);
        if (at <= width) { c.fillRect(Math.round(at), 0, 1, FORCE_HEIGHT); c.fillText(text, at + 4, 11 + (text === times[0][0] ? 0 : 13)); }
      }
      c.strokeStyle = colours.force;
      c.lineWidth = 2;
      c.beginPath();
      for (const [time_s, mN] of points) if (x(time_s) > -20) c.lineTo(x(time_s), y(mN));
      c.stroke();
    });
  }
  function load() {
    if (usages.length) return;
    readUsages().then((all) => { usages = all; engine.draw(); }, () => engine.fail("the names of the keys cannot be loaded: reload this window"));
  }

  return (shown, changes) => {
    if ("board" in changes) length_um = changes.board?.length_um ?? USUAL_LENGTH_UM;
    if ("editor" in changes || "may_command" in changes || "board" in changes) engine.take(shown.editor, shown.may_command);
    if (root.hidden) return;
    const touch = shown.touch, share = placed(touch) ? touch.position_um / length_um : -1;
    const down = engine.changed ? [] : shown.keys?.down ?? [];
    finger.classList.toggle("on", share >= 0);
    if (share >= 0) finger.style.transform = `translateX(${100 * Math.min(share, 1)}cqw)`;
    drawn.zones.forEach(({ low, high }, i) => {
      zoneElements[i]?.classList.toggle("under", share >= low && share < high);
      zoneElements[i]?.classList.toggle("lit", down.some((one) => one.layer === drawn.layer && one.index === i));
    });
    const kind = engine.changed ? "tried" : "key";
    for (const event of changes.events) {
      if (event.kind !== kind || !event.pressed) continue;
      trial.append(make("span", "", event.name));
      while (trial.children.length > TRIED) trial.firstChild.remove();
    }
    const tries = `With this ${engine.changed ? "draft" : "layout"}, the finger types:`;
    if (trialWords.textContent !== tries) trialWords.textContent = tries;
    for (const one of changes.touches) points.push([one.time_s, one.touching ? one.force_mN ?? 0 : 0]);
    if (points.length > FORCE_KEPT) points.splice(0, FORCE_KEPT / 4);
    if (tuning.open && draft.value) drawForce(shown.editor.limits);
    const words = share < 0 ? "Touch the strip to see its zone." : `The finger is at ${mm(share)}.`;
    if (place.textContent !== words) place.textContent = words;
  };
}
