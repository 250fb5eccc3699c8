// Names of actions: keys of the HID Usage Tables with modifiers, and layers. Search by name.
import { make } from "../dom.js";
import { LAYER_VERBS, NAMED, WORDS } from "./file.js";

const TEXT_ON_KEY = 12;  // characters of a text on its key
const KEYBOARD = "0x07", MOST = 8;  // HID usage page of keyboards; actions in a list
const AMERICAN = /^[ -~]$/;  // characters that need no host
const VERB_WORDS = {
  momentary: "this layer while the key is held", toggle: "this layer on or off", to: "this layer only",
  sticky: "this layer for the next key", key_repeat: "the last key again", caps_word: "capitals until the end of a word",
  tap_dance: "by the number of taps", mod_morph: "another action with a modifier",
  macro: "several keys, one after the other",
};

// Returns a promise of all keys; the file is read only one time. A key has, among others: `name` in the
// HID Usage Tables, `value`, its shortest name in a layout file, `words` to show, `search` to search in.
let reading = null;
export function readUsages() {
  return reading ??= read();
}

async function read() {
  const [lines, others] = await Promise.all(["usages", "aliases"].map(linesOf)), taken = new Set();
  const aliases = new Map(others.map((line) => line.trim().split(/\s+/)).map(([name, ...all]) => [name, all]));
  return lines.map((line) => {
    const [page, usage, name, linux, pynput = ""] = line.trim().split(/\s+/);
    const character = page === KEYBOARD && [...pynput].length === 1 && !taken.has(pynput) ? pynput.toUpperCase() : "";
    if (character) taken.add(pynput);
    const code = parseInt(usage, 16);
    const modifier = page === KEYBOARD && code >= 0xe0 && code <= 0xe7;
    const words = linux.replace("KEY_", "").toLowerCase(), also = (aliases.get(name) ?? []).map((one) => one.toLowerCase());
    return {
      name, page, character, modifier, value: /^[A-Z0-9]$/.test(character) ? character : name,
      words: page === KEYBOARD ? "key" : "media", search: [name.toLowerCase(), words, ...also].join(" "), also,
    };
  });
}

async function linesOf(name) {
  const answer = await fetch(`static/${name}.txt`);
  if (!answer.ok) throw new Error(answer.statusText);
  return (await answer.text()).split("\n").filter((line) => line && !line.startsWith("#"));
}

// Returns the label of a key for an action: a character, a key's name or a layer's name. `caps`: the
// characters on the keys of the layout's computer by the names of the keys, or null.
export function cap(usages, action, caps = null) {
  const [verb, of] = action.split(/ (.*)/);
  if (WORDS.includes(action)) return action.replace("_", " ");
  if (verb === "sticky" && usages.some((one) => one.name === of)) return of;
  if (verb === "text" && of) return capOfText(of);
  if (LAYER_VERBS.includes(verb) || NAMED.includes(verb)) return of ?? "";
  const name = (action.length > 1 && action.split("+").at(-1)) || action;
  const found = usages.find((one) => one.name === name.toUpperCase() || one.character === name.toUpperCase());
  if (found && caps && [...name].length > 1) return caps[found.name] || found.character || found.name;
  return found ? found.character || found.name : name;
}

// Returns the label of a key that types a text.
export function capOfText(text) {
  return [...text.trim().replace(/\s+/g, " ")].slice(0, TEXT_ON_KEY).join("");
}

// Returns the characters of a text that the computer does not type. `types`: the characters that it types.
export function missing(text, types) {
  return types ? [...new Set(text)].filter((one) => !types.has(one) && one !== "\n" && one !== "\t") : [];
}

// Returns the actions of a layout that are no keys: {value, words}, as `matches` does.
function actionsOf(usages, content) {
  const names = content.layer.map((one) => one.name);
  const of = (verb, some) => some.map((name) => ({ value: `${verb} ${name}`, words: VERB_WORDS[verb] }));
  return [
    ...LAYER_VERBS.flatMap((verb) => of(verb, verb === "to" ? names : names.slice(1))),
    ...usages.filter((one) => one.modifier).map(({ name }) => ({ value: `sticky ${name}`, words: "this modifier for the next key" })),
    ...WORDS.map((word) => ({ value: word, words: VERB_WORDS[word] })),
    ...NAMED.flatMap((verb) => of(verb, Object.keys(content[verb] ?? {}))),
  ];
}

// Returns the actions that fit a typed text, the best first: {value, words}. `value` is the action in a
// layout file, `words` explain it. `content` is the layout; without one, only keys fit. `types`: the
// characters that the layout's computer types. An action with `off` cannot be chosen.
export function matches(usages, content, typed, types = null) {
  const text = typed.trim(), actions = content ? actionsOf(usages, content) : [];
  const parts = text.length > 1 ? text.split("+") : [text];
  const wanted = (parts.pop() ?? "").trim().toLowerCase().replace(/\s+/g, "_");
  const modifiers = parts.map((part) => {
    const name = part.trim().toLowerCase().replace(/\s+/g, "_");
    const of = (fits) => usages.find((one) => one.modifier && fits(one))?.name;
    return of((one) => one.also.includes(name)) ?? (name === "strg" ? "LEFT_CONTROL" : of((one) => one.name.toLowerCase().startsWith(name)));
  });
  if (modifiers.includes(undefined)) return [];
  const before = modifiers.map((one) => `${one}+`).join("");
  const keys = usages.filter((one) => !before || one.page === KEYBOARD)
    .map((one) => ({ one, rank: rank(one, wanted) })).filter(({ rank }) => rank < 9);
  keys.sort((a, b) => a.rank - b.rank);
  const found = keys.map(({ one }) => ({
    value: before + one.value, words: one.value === one.name ? one.words : one.name.toLowerCase().replaceAll("_", " "),
  }));
  found.unshift(...characters(content, before, parts.length ? text.split("+").at(-1).trim() : text, types));
  const ways = before ? [] : actions.filter(({ value }) => value.toLowerCase().includes(text.toLowerCase()));
  const exact = ways.some(({ value }) => value === text);
  return (exact ? [...ways, ...found] : [...found.slice(0, MOST - Math.min(ways.length, 3)), ...ways]).slice(0, MOST);
}

// Returns the action for a typed character: none if the layout has no host and a key of an American
// keyboard has the character, because this key is found by its name.
function characters(content, before, typed, types) {
  if (!content || [...typed].length !== 1 || (!content.host && AMERICAN.test(typed))) return [];
  if (!content.host) return [{ value: before + typed, words: "choose the layout of your computer first", off: true }];
  if (missing(typed, types).length) return [{ value: before + typed, words: `not on the host ${content.host}`, off: true }];
  return [{ value: before + typed, words: `on the host ${content.host}` }];
}

// Returns how well a key fits a typed name: 0 is best, 9 means that it does not fit.
function rank(one, wanted) {
  const name = one.name.toLowerCase();
  if (!wanted) return 5;
  if (one.character.toLowerCase() === wanted) return 0;
  if (name === wanted || one.also.includes(wanted)) return 1;
  if (name.startsWith(wanted)) return 2;
  if (one.search.split(/[ _]/).some((word) => word.startsWith(wanted))) return 3;
  return one.search.includes(wanted) ? 4 : 9;
}

// A field for an action, with a list to choose from. `find(text)` returns the actions that fit a text.
// `onChoose(value)` is called with the chosen action, or with an empty string. The field is disabled
// until `show` is called with `ready`: before the keys' names are loaded, no text fits.
let fields = 0;
export function actionField(name, find, onChoose) {
  const id = `action-${++fields}`;
  const input = make("input"), list = make("ul", "options");
  input.id = id;
  input.autocomplete = "off";
  input.spellcheck = false;
  input.setAttribute("role", "combobox");
  input.setAttribute("aria-autocomplete", "list");
  input.setAttribute("aria-controls", `${id}-list`);
  input.setAttribute("aria-expanded", "false");
  list.id = `${id}-list`;
  list.setAttribute("role", "listbox");
  list.ariaLabel = name;
  list.hidden = true;
  const label = make("label", "", name);
  label.htmlFor = id;
  const root = make("div", "action", label, make("div", "combo", input, list));
  let value = "", options = [], chosen = -1;

  function open(typed) {
    options = find(typed.normalize());
    list.replaceChildren(...options.map((one, i) => {
      const item = make("li", "", make("b", "", one.value), make("span", "", one.words));
      item.id = `${id}-${i}`;
      item.setAttribute("role", "option");
      if (one.off) item.setAttribute("aria-disabled", "true");
      // Not "click", because a click comes after the field has lost its focus.
      item.addEventListener("pointerdown", (event) => { event.preventDefault(); if (!one.off) choose(one.value); });
      return item;
    }));
    list.hidden = !options.length;
    input.setAttribute("aria-expanded", String(!list.hidden));
    point(options.length && typed.trim() ? 0 : -1);
  }
  function point(index) {
    chosen = index;
    [...list.children].forEach((item, i) => item.setAttribute("aria-selected", String(i === index)));
    if (index < 0) input.removeAttribute("aria-activedescendant");
    else {
      input.setAttribute("aria-activedescendant", `${id}-${index}`);
      list.children[index].scrollIntoView({ block: "nearest" });
    }
  }
  function close() {
    list.hidden = true;
    input.setAttribute("aria-expanded", "false");
    input.removeAttribute("aria-activedescendant");
    chosen = -1;
  }
  function choose(text) {
    close();
    input.value = text;
    if (text !== value) onChoose(value = text);
  }

  input.addEventListener("focus", () => input.select());
  input.addEventListener("click", () => { if (list.hidden) open(""); });
  input.addEventListener("input", () => open(input.value));
  input.addEventListener("keydown", (event) => {
    if (event.isComposing) return;  // these keys belong to the input method
    if (event.key === "ArrowDown" || event.key === "ArrowUp") {
      event.preventDefault();
      if (list.hidden) open("");
      else if (options.length) point((chosen + (event.key === "ArrowDown" ? 1 : options.length - 1 + (chosen < 0))) % options.length);
    } else if (event.key === "Enter") {
      event.preventDefault();
      if (!input.value.trim()) choose("");
      else if (!list.hidden && chosen >= 0 && !options[chosen].off) choose(options[chosen].value);
    } else if (event.key === "Escape" && !list.hidden) {
      event.stopPropagation();
      input.value = value;
      close();
    }
  });
  // When the focus leaves the field, a typed action is chosen; otherwise the value does not change.
  input.addEventListener("blur", () => {
    const typed = input.value.trim().normalize(), best = typed === value ? null : find(typed).find((one) => !one.off);
    if (!typed) choose("");
    else if (best && !list.hidden) choose(best.value);
    else { input.value = value; close(); }
  });
  return { root, input, show: (text, ready) => {
    input.disabled = !ready;
    if (text !== value || document.activeElement !== input) value = input.value = text;
  } };
}
