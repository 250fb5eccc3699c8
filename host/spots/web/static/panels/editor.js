// The layout editor: zones over the living strip, their actions, and the way to the board.
// Only a browser with the token has it; the server checks and stores each layout.
import { make, placed } from "../dom.js";
import { actionField, cap, matches, readUsages } from "../layout/actions.js";
import { makeDraft } from "../layout/draft.js";
import * as file from "../layout/file.js";

const USUAL_LENGTH_UM = 85000, CHECK_MS = 250, STEP_MM = 0.5, FINE_MM = 0.1;
const TUNING = {
  detect: ["Readings that make a press", ""], flavour: ["A hold is decided", ""],
  press_mN: ["Force that begins a touch", "mN"], release_mN: ["Force that ends a touch", "mN"],
  firm_mN: ["Force of a firm press", "mN"], firm_ms: ["Time for a firm press", "ms"],
  tapping_ms: ["A longer touch is a hold", "ms"], double_ms: ["Longest pause of a double tap", "ms"],
  quick_ms: ["Pause of a repeated tap", "ms"], slack_um: ["Slack of a repeated tap", "µm"],
  slide_um: ["Step of a slide", "µm"], swipe_um: ["Least length of a swipe", "µm"],
  swipe_ms: ["Longest time of a swipe", "ms"], release_ms: ["Release debounce", "ms"],
  jump_um: ["Longest jump of a finger", "µm"], stuck_ms: ["An object, not a finger, after", "ms"],
};
const STORED = {
  this: "on the board", default: "not on the board: it has its default layout",
  other: "not on the board: it has another layout", null: "no board is connected",
};

export function editor(root) {
  const opener = document.getElementById("edit"), clearer = document.getElementById("clear");
  let it = null, may = false, open = false, usages = [], length_um = USUAL_LENGTH_UM;
  let layer = 0, zone = 0, problem = "", news = "", loses = [], checking = 0, busy = false, dragging = false, changed = false;
  let drawn = { layer: "", zones: [] };
  const draft = makeDraft(() => { news = ""; refresh(); check(); });

  // The parts of the panel, in the order of reading.
  const title = make("h2", "", "Key layout"), name = text("Name of the layout");
  const undo = button("Undo", () => draft.undo()), redo = button("Redo", () => draft.redo());
  undo.ariaKeyShortcuts = "Control+Z";
  redo.ariaKeyShortcuts = "Control+Shift+Z";
  const head = make("div", "head", title, name, undo, redo);
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
  const find = (typed) => matches(usages, draft.value.content.layer.map((one) => one.name), typed);
  const actions = Object.entries(file.SLOTS).map(([slot, words]) =>
    [slot, actionField(words, find, (value) => edit((it) => file.change(it, zone, { [slot]: value })))]);
  const ofZone = make("fieldset", "zone-form", make("legend"), make("div", "fields", field(label), field(width)),
    make("div", "fields", ...actions.map(([, one]) => one.root)), zoneButtons);
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
  const state = make("p", "state"), ask = make("dialog", "ask");
  state.role = "status";
  const push = button("Put on the board", () => send());
  push.className = "main";
  const chooser = make("input");
  chooser.type = "file";
  chooser.accept = ".toml";
  chooser.ariaLabel = "Layout file to import";
  chooser.hidden = true;
  const foot = make("div", "buttons foot", push, button("New", () => { layer = zone = 0; draft.set({ content: file.empty(), head: "", others: 0 }); }),
    button("Import…", () => chooser.click()), button("Export", download), chooser);
  root.append(head, make("div", "layers-row", tabs, addLayer), row, place, state, foot, ofZone, ofLayer, tuning, ask);

  function button(words, onClick) {
    const one = make("button", "", words);
    one.type = "button";
    one.addEventListener("click", onClick);
    return one;
  }
  function text(words) {
    const one = make("input");
    one.ariaLabel = words;
    one.autocomplete = "off";
    one.maxLength = 60;
    return one;
  }
  function number(words) {
    const one = text(words);
    one.type = "number";
    one.step = "any";
    return one;
  }
  function field(input) {
    return make("label", "", make("span", "", input.ariaLabel), input);
  }

  // Changes the layer in the draft, as one step of undo.
  function edit(mutate, replace = false) {
    const value = draft.value;
    mutate(value.content.layer[layer], value.content);
    draft.set(value, replace);
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
    // The others keep their proportions.
    const rest = 1 - (all[zone].high - all[zone].low);
    if (!(share > 0 && share < 1) || !rest) return;
    const units = all.reduce((sum, { key }, i) => (i === zone ? sum : sum + (key.width ?? 1)), 0);
    file.change(it, zone, { width: Number((units * share / (1 - share)).toFixed(4)) });
  }));
  layerName.addEventListener("change", () => {
    const value = draft.value, wanted = layerName.value.trim();
    if (wanted && !value.content.layer.some((one) => one.name === wanted)) file.renameLayer(value.content, layer, wanted);
    draft.set(value);
    refresh();
  });
  gap.addEventListener("change", () => edit((it) => {
    if (Number(gap.value)) it.gap_percent = Number(gap.value);
    else delete it.gap_percent;
  }));
  root.addEventListener("keydown", (event) => {
    const undoes = (event.ctrlKey || event.metaKey) && event.key.toLowerCase() === "z";
    const redoes = (event.ctrlKey && event.key.toLowerCase() === "y") || (undoes && event.shiftKey);
    if (event.target.matches("input") || !(undoes || redoes)) return;
    event.preventDefault();
    (redoes ? draft.redo : draft.undo)();
  });
  opener.addEventListener("click", () => {
    open = !open;
    remember();
    show();
  });
  clearer.addEventListener("click", async () => {
    const answer = await post({ do: "clear" });
    news = answer.refused ?? "the board has its default layout again; undo brings yours back to this editor";
    showState();
    if (answer.refused) { open = true; show(); }
  });
  function remember() {
    try { sessionStorage.setItem("spots-editing", open ? "1" : ""); } catch { /* closed after a reload */ }
  }
  try { open = Boolean(sessionStorage.getItem("spots-editing")); } catch { /* as above */ }

  // Zones and borders. Tab reaches the zone that is shown below and its borders; arrows do the rest.
  const zoneElements = [], borders = [];
  function zoneElement(i) {
    return zoneElements[i] ??= (() => {
      const one = make("button", "zone", make("b"), make("small"));
      one.type = "button";
      one.addEventListener("click", () => { zone = i; refresh(); });
      one.addEventListener("keydown", (event) => {
        const to = { ArrowLeft: i - 1, ArrowRight: i + 1, Home: 0, End: draft.value.content.layer[layer].keys.length - 1 }[event.key];
        if (to === undefined || !zoneElements[to]?.isConnected) return;
        event.preventDefault();
        zone = to;
        refresh();
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
        one.addEventListener(end, () => { one.onpointermove = null; dragging = false; check(); });
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
    const written = [key.tap, key.firm, key.hold].filter(Boolean).map((action) => cap(usages, action));
    const characters = written.filter((one) => [...one].length === 1);
    return key.label ?? (characters.length > 1 ? characters.join(" ") : written[0] ?? "");
  }

  // Shows the draft.
  function refresh() {
    const value = draft.value;
    if (!value || !it || root.hidden) return;
    const { content } = value;
    layer = Math.min(layer, content.layer.length - 1);
    const now = content.layer[layer], all = file.zones(now);
    drawn = { layer: now.name, zones: all };
    zone = Math.min(zone, all.length - 1);
    put(name, content.name);
    undo.disabled = !draft.canUndo;
    redo.disabled = !draft.canRedo;
    while (tabs.children.length > content.layer.length) tabs.lastChild.remove();
    content.layer.forEach((one, i) => {
      const tab = tabs.children[i] ?? tabs.appendChild(button("", () => { layer = i; zone = 0; refresh(); }));
      tab.textContent = one.name;
      tab.setAttribute("aria-pressed", String(i === layer));
    });
    const children = [finger];
    all.forEach(({ key, low, high }, i) => {
      const one = zoneElement(i), gap = (now.gap_percent ?? 0) / 200 * (high - low);
      one.style.left = `calc(${100 * (low + (i ? gap : 0))}% + 1px)`;
      one.style.width = `calc(${100 * (high - low - (i ? gap : 0) - (i + 1 < all.length ? gap : 0))}% - 2px)`;
      one.children[0].textContent = words(key) || "·";
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
    for (const [slot, one] of actions) one.show(key[slot] ?? "");
    ofLayer.firstChild.textContent = `Layer ${now.name}`;
    put(layerName, now.name);
    put(gap, String(now.gap_percent ?? 0));
    for (const [slot, one] of swipes) one.show(now[slot] ?? "");
    removeLayer.disabled = content.layer.length === 1;
    for (const [statement, { show }] of Object.entries(tunings)) show(content.tuning?.[statement]);
    showState();
  }

  // The fields of [tuning], with the limits that the server sends.
  let tunings = {};
  function layTuning() {
    tunings = Object.fromEntries(Object.entries(it.limits).map(([statement, [low, high, usual]]) => {
      const [words, unit] = TUNING[statement] ?? [statement, ""];
      const set = (value) => edit((_, content) => {
        const values = { ...content.tuning, [statement]: value };
        if (value === undefined) delete values[statement];
        if (Object.keys(values).length) content.tuning = values;
        else delete content.tuning;
      });
      if (statement === "flavour") {
        const choice = make("select", "", ...it.flavours.map((one) => new Option(one)));
        choice.addEventListener("change", () => set(choice.value === it.flavours[usual] ? undefined : choice.value));
        return [statement, { root: make("label", "", make("span", "", words), choice), show: (value) => { choice.value = value ?? it.flavours[usual]; } }];
      }
      const exact = number(`${words}${unit && `, ${unit}`}`), slider = make("input");
      slider.type = "range";
      slider.ariaLabel = `${words}, slider`;
      Object.assign(slider, { min: low, max: Math.min(high, usual ? 4 * usual : 4000), step: usual > 1000 ? 50 : usual > 20 ? 5 : 1 });
      Object.assign(exact, { min: low, max: high, step: 1 });
      const take = (input) => {
        const value = Math.min(Math.max(Math.round(Number(input.value)), low), high);
        set(value === usual ? undefined : value);
        put(exact, String(value), true);
      };
      exact.addEventListener("change", () => take(exact));
      slider.addEventListener("change", () => take(slider));
      slider.addEventListener("input", () => { exact.value = slider.value; });
      return [statement, { root: make("div", "tune", field(exact), slider), show: (value) => { put(exact, String(value ?? usual)); slider.value = value ?? usual; } }];
    }));
    tuning.lastChild.replaceChildren(...Object.values(tunings).map((one) => one.root));
  }

  function put(input, value, always = false) {
    if (always || (document.activeElement !== input && input.value !== value)) input.value = value;
    else if (document.activeElement === input && input.value !== value && !input.matches(":focus-visible")) input.value = value;
  }
  function mm(share) {
    return `${((share * length_um) / 1000).toFixed(1)} mm`;
  }

  // The text of the draft. What was not changed keeps its text, with all comments.
  function textOf(value) {
    return same(value.content, it.content) ? it.text : file.written(value.content, value.head);
  }
  function same(a, b) {
    return file.written(a) === file.written(b);
  }
  function showState() {
    if (!it) return;
    changed = Boolean(draft.value) && !same(draft.value.content, it.content);
    const words = problem || news || (it.stored === null ? STORED.null : changed ? `not on the board yet${loses.length ? `; nothing will type ${listed(loses)}` : ""}`
      : STORED[it.stored] ?? "");
    if (state.textContent !== words) state.textContent = words;
    state.dataset.kind = problem ? "bad" : changed || it.stored !== "this" ? "new" : "good";
    push.disabled = Boolean(problem) || busy || it.stored === null || !(changed || it.stored !== "this");
    clearer.hidden = !may || !["this", "other"].includes(it.stored);
    clearer.disabled = busy;
  }

  async function post(message) {
    busy = true;
    showState();
    try {
      const answer = await fetch("layout", { method: "POST", body: JSON.stringify(message) });
      if (!answer.ok) return { refused: await answer.text() };
      return answer.status === 204 ? {} : await answer.json();
    } catch {
      return { refused: "the server does not answer: try again" };
    } finally {
      busy = false;
      showState();
    }
  }

  // The server checks the draft shortly after the last change.
  let asked = 0;
  function check() {
    clearTimeout(checking);
    if (!draft.value || !it || !may || !open || dragging) return;
    checking = setTimeout(async () => {
      const number = ++asked;
      let answer;
      try {
        const got = await fetch("layout", { method: "POST", body: JSON.stringify({ do: "check", text: textOf(draft.value) }) });
        answer = got.ok ? await got.json() : { refused: await got.text() };
      } catch { return; }
      if (number !== asked) return;
      problem = answer.refused ?? "";
      loses = answer.loses ?? [];
      showState();
    }, CHECK_MS);
  }

  async function send() {
    const value = draft.value;
    if (!(await mayLose(value, "Put on the board"))) return;
    const message = { do: "push", text: textOf(value), base: it.base, loses: [] };
    let answer = await post(message);
    if (answer.loses?.length) {
      if (!(await question(`With this layout, nothing types ${listed(answer.loses)} any more.`, "Put it on the board"))) return;
      answer = await post({ ...message, loses: answer.loses });
    }
    problem = answer.refused ?? "";
    news = answer.refused ? "" : answer.note ? `on the board: ${answer.note}` : "";
    showState();
  }

  // Comments are kept with an unchanged text; otherwise one is asked before any are lost.
  async function mayLose(value, go) {
    if (!value.others || textOf(value) === it.text) return true;
    const count = value.others === 1 ? "1 comment" : `${value.others} comments`;
    if (!(await question(`${count} of the file will be lost: only the comments at its begin are kept.`, go))) return false;
    draft.set({ ...value, others: 0 });
    return true;
  }

  async function download() {
    const value = draft.value;
    if (!(await mayLose(value, "Export"))) return;
    const link = make("a");
    link.href = URL.createObjectURL(new Blob([textOf(value)], { type: "application/toml" }));
    link.download = it.file;
    link.click();
    setTimeout(() => URL.revokeObjectURL(link.href), 1000);
  }
  chooser.addEventListener("change", async () => {
    const [chosen] = chooser.files;
    if (!chosen) return;
    const text = await chosen.text();
    chooser.value = "";
    const answer = await post({ do: "check", text });
    if (answer.refused) news = `${chosen.name}: ${answer.refused}`;
    else {
      layer = zone = 0;
      draft.set({ content: answer.content, ...file.comments(text) });
    }
    showState();
  });

  function question(words, yes) {
    return new Promise((done) => {
      const finish = (answer) => () => { ask.close(answer); };
      ask.replaceChildren(make("p", "", words), make("div", "buttons", button(yes, finish("yes")), button("Cancel", finish(""))));
      ask.ariaLabel = words;
      ask.onclose = () => done(ask.returnValue === "yes");
      ask.returnValue = "";
      ask.showModal();
    });
  }
  function listed(names) {
    return names.length > 8 ? `${names.slice(0, 7).join(", ")} and ${names.length - 7} more` : names.join(", ");
  }

  function show() {
    opener.hidden = !it || !may;
    root.hidden = !it || !may || !open;
    opener.textContent = open ? "close" : "edit keys";
    opener.setAttribute("aria-expanded", String(!root.hidden));
    document.body.dataset.editing = root.hidden ? "off" : "on";
    if (!it) return;
    showState();
    if (root.hidden) return;
    if (!usages.length) {
      readUsages().then((all) => { usages = all; refresh(); }, () => { problem = "the names of the keys cannot be loaded: reload this window"; showState(); });
    }
    refresh();
    check();
  }

  return (shown, changes) => {
    if ("board" in changes) length_um = changes.board?.length_um ?? USUAL_LENGTH_UM;
    if ("editor" in changes || "may_command" in changes || "board" in changes) {
      const first = !it;
      it = shown.editor ?? null;
      may = Boolean(shown.may_command);
      if (first && it) layTuning();
      if (it && may) {
        // Another layout on the server becomes the draft; undo returns to the one that was here.
        if (draft.base !== it.base) {
          if (!draft.value || !same(draft.value.content, it.content)) draft.set({ content: it.content, ...file.comments(it.text) });
          draft.base = it.base;
        }
      }
      show();
    }
    if (root.hidden) return;
    const touch = shown.touch, share = placed(touch) ? touch.position_um / length_um : -1;
    const down = changed ? [] : shown.keys?.down ?? [];
    finger.classList.toggle("on", share >= 0);
    if (share >= 0) finger.style.transform = `translateX(${100 * Math.min(share, 1)}cqw)`;
    drawn.zones.forEach(({ low, high }, i) => {
      zoneElements[i]?.classList.toggle("under", share >= low && share < high);
      zoneElements[i]?.classList.toggle("lit", down.some((one) => one.layer === drawn.layer && one.index === i));
    });
    const words = share < 0 ? "Touch the strip to see its zone." : `The finger is at ${mm(share)}.`;
    if (place.textContent !== words) place.textContent = words;
  };
}
