// Parts of the layout editor: the rule of a hold with its timing picture, and the tables that an action
// names (tap dances and mod-morphs).
import { button, field, number, put, text } from "../controls.js";
import { make } from "../dom.js";
import { actionField } from "../layout/actions.js";
import * as file from "../layout/file.js";

const MODIFIERS = ["LEFT_CONTROL", "LEFT_SHIFT", "LEFT_ALT", "LEFT_GUI", "RIGHT_CONTROL", "RIGHT_SHIFT", "RIGHT_ALT", "RIGHT_GUI"];
const MOST_TAPS = 8, LEAST_TAPS = 2;
const TERMS = {
  tapping_term_ms: "Hold after, ms", quick_tap_ms: "Held tap within, ms",
  require_prior_idle_ms: "Only a tap after another key, ms",
};

function tick(words) {
  const box = make("input");
  box.type = "checkbox";
  return { box, root: make("label", "check-line", box, make("span", "", words)) };
}

// The rule of a hold: flavor and terms of a zone. `change(parts)` changes the zone.
export function holdRule(change) {
  const flavor = make("select"), retro = tick("Without another key, always a tap"), picture = make("div", "timing");
  flavor.ariaLabel = "Decided by";
  const terms = Object.entries(TERMS).map(([name, words]) => [name, number(words)]);
  const root = make("fieldset", "hold-rule", make("legend", "", "Tap or hold"),
    make("div", "fields", field(flavor), ...terms.map(([, input]) => field(input))), retro.root, picture);
  flavor.addEventListener("change", () => change({ flavor: flavor.value }));
  retro.box.addEventListener("change", () => change({ retro_tap: retro.box.checked || undefined }));
  for (const [name, input] of terms) {
    input.step = 1;
    input.addEventListener("change", () => change({ [name]: input.value === "" ? undefined : Math.round(Number(input.value)) }));
  }
  let drawn = "";
  // Shows the rule of a key; `it` is the part of the state that describes the file.
  function show(key, content, it) {
    root.hidden = !key.hold;
    if (root.hidden) return;
    const tuned = content.tuning ?? {}, usual = tuned.flavor ?? it.flavors[it.limits.flavor[2]];
    const options = ["", ...it.flavors];
    if (flavor.options.length !== options.length) flavor.replaceChildren(...options.map((one) => new Option(one, one)));
    flavor.options[0].text = `usual: ${usual}`;
    flavor.value = key.flavor ?? "";
    retro.box.checked = key.retro_tap ?? false;
    for (const [name, input] of terms) {
      const [low, high, value] = it.limits[name];
      Object.assign(input, { min: low, max: high, placeholder: `${tuned[name] ?? value}` });
      put(input, String(key[name] ?? ""));
    }
    const name = (key.flavor ?? usual) + (key.retro_tap ? ", retro_tap" : "");
    if (name === drawn) return;
    drawn = name;
    const parsed = new DOMParser().parseFromString(it.timing[name], "image/svg+xml").documentElement;
    picture.replaceChildren(document.importNode(parsed, true));
  }
  return { root, show };
}

// The tables of a layout. `edit(mutate)` changes the layout, `find(typed)` returns the actions that fit.
export function tables(edit, find) {
  const cards = make("div", "tables"), root = make("details", "behaviours", make("summary", "", "Tap dances and mod-morphs"),
    make("p", "place", "A key uses one by its name, such as ‘tap_dance quotes’ or ‘mod_morph back’."), cards,
    make("div", "buttons",
      button("Add a tap dance", () => add("tap_dance", { actions: ["", ""] })),
      button("Add a mod-morph", () => add("mod_morph", { action: "", morphed: "", mods: ["LEFT_SHIFT"] }))));
  let shape = "", shows = [];

  function add(kind, table) {
    edit((content) => {
      content[kind] ??= {};
      let i = 1;
      while (`${kind.split("_")[1]}${i}` in content[kind]) i++;
      content[kind][`${kind.split("_")[1]}${i}`] = table;
    });
  }
  function card(kind, name, table) {
    const named = text(kind === "tap_dance" ? "Name of the tap dance" : "Name of the mod-morph"), change = (mutate) => edit((content) => mutate(content[kind][name]));
    const one = make("fieldset", "card-of-table", make("legend", "", `${kind} ${name}`), make("div", "fields", field(named)));
    const shown = [() => put(named, name)];
    named.addEventListener("change", () => edit((content) => file.renameTable(content, kind, name, named.value.trim())));
    const buttons = make("div", "buttons");
    (kind === "tap_dance" ? dance : morph)(one, table, change, shown, buttons);
    buttons.append(button(`Remove ${name}`, () => edit((content) => file.renameTable(content, kind, name, ""))));
    one.append(buttons);
    return { one, show: (now, ready, it, content) => shown.forEach((each) => each(now, ready, it, content)) };
  }
  function dance(one, table, change, shown, buttons) {
    const fields = make("div", "fields");
    table.actions.forEach((_, i) => {
      const taps = i ? `${i + 1} taps` : "1 tap";
      const tap = actionField(taps, find, (value) => change((it) => { it.actions[i] = value; }));
      const held = actionField(`${taps}, the last one held`, find, (value) => change((it) => file.setHold(it, i, value)));
      fields.append(tap.root, held.root);
      shown.push((now, ready) => { tap.show(now.actions[i] ?? "", ready); held.show(now.holds?.[i] ?? "", ready); });
    });
    const term = number("Time between two taps, ms");
    term.step = 1;
    term.addEventListener("change", () => change((it) => {
      if (term.value) it.tapping_term_ms = Math.round(Number(term.value));
      else delete it.tapping_term_ms;
    }));
    shown.push((now, _, it, content) => {
      const [low, high, usual] = it.limits.tapping_term_ms;
      Object.assign(term, { min: low, max: high, placeholder: `${content.tuning?.tapping_term_ms ?? usual}` });
      put(term, String(now.tapping_term_ms ?? ""));
    });
    one.append(fields, make("div", "fields", field(term)));
    const more = button("One more tap", () => change((it) => it.actions.push("")));
    const less = button("One tap less", () => change((it) => { it.actions.pop(); file.setHold(it, it.actions.length, ""); }));
    more.disabled = table.actions.length >= MOST_TAPS;
    less.disabled = table.actions.length <= LEAST_TAPS;
    buttons.append(more, less);
  }
  function morph(one, table, change, shown) {
    const fields = make("div", "fields");
    for (const [name, words] of [["action", "without the modifiers"], ["morphed", "with one of them"]]) {
      const each = actionField(words, find, (value) => change((it) => { it[name] = value; }));
      fields.append(each.root);
      shown.push((now, ready) => each.show(now[name] ?? "", ready));
    }
    const row = make("div", "check-lines"), keeps = make("div", "check-lines");
    row.setAttribute("role", "group");
    row.ariaLabel = "Modifiers";
    keeps.setAttribute("role", "group");
    keeps.ariaLabel = "Modifiers that stay down";
    for (const [part, group] of [["mods", row], ["keep_mods", keeps]]) {
      for (const modifier of MODIFIERS) {
        const { box, root: line } = tick(modifier);
        box.addEventListener("change", () => change((it) => file.setModifier(it, part, modifier, box.checked)));
        group.append(line);
        shown.push((now) => {
          box.checked = (now[part] ?? []).includes(modifier);
          line.hidden = part === "keep_mods" && !now.mods.includes(modifier);
        });
      }
    }
    one.append(fields, make("p", "place", "Modifiers"), row, make("p", "place", "Modifiers that stay down with the other action"), keeps);
  }

  // Shows the tables of a layout; `ready`: whether the names of the keys are loaded.
  function show(content, ready, it) {
    const all = file.TABLES.flatMap((kind) => Object.entries(content[kind] ?? {}).map(([name, table]) => [kind, name, table]));
    const now = JSON.stringify(all.map(([kind, name, table]) => [kind, name, table.actions?.length]));
    if (now !== shape) {
      shape = now;
      shows = all.map(([kind, name, table]) => card(kind, name, table));
      cards.replaceChildren(...shows.map(({ one }) => one));
    }
    all.forEach(([, , table], i) => shows[i].show(table, ready, it, content));
  }
  return { root, show };
}
