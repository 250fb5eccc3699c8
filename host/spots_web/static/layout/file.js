// Changes a layout. A layout is an object as the server sends it: the content
// of a layout file, without entries that have default values.

export const SLOTS = {
  tap: "tap", double: "double tap", hold: "hold", firm: "firm press",
  slide_minus: "slide to the sensor", slide_plus: "slide away",
};
export const SWIPES = { swipe_minus: "swipe to the sensor", swipe_plus: "swipe away" };
export const LAYER_VERBS = ["momentary", "toggle", "to", "sticky"];
// Actions that need no name, and tables of the file that name an action.
export const WORDS = ["key_repeat", "caps_word"];
export const TABLES = ["tap_dance", "mod_morph"];
export const NAMED = [...TABLES, "macro"];
// Parts of a key that only a key with a hold has.
const OF_HOLD = ["flavor", "retro_tap", "tapping_term_ms", "quick_tap_ms", "require_prior_idle_ms"];
export const LEAST_SHARE = 0.01;  // smallest zone, as a share of the strip

export function empty() {
  return { name: "My layout", layer: [{ name: "keys", keys: [{}] }] };
}

// Returns a key as an object of its actions. In a file, a key with only a tap is a string.
export function table(key) {
  return typeof key === "string" ? { tap: key } : key;
}

// Returns the zones of a layer: {key, low, high}. Bounds are shares of the strip, without gaps.
export function zones(layer) {
  const widths = layer.keys.map((key) => table(key).width ?? 1);
  const whole = widths.reduce((a, b) => a + b, 0);
  let low = 0;
  return layer.keys.map((key, i) => {
    const zone = { key: table(key), low: low / whole, high: (low + widths[i]) / whole };
    low += widths[i];
    return zone;
  });
}

// Changes a key of a layer. Parts that are empty or have the default value are removed.
export function change(layer, index, parts) {
  const key = Object.fromEntries(Object.entries({ ...table(layer.keys[index]), ...parts })
    .filter(([name, value]) => value !== "" && value !== undefined && !(name === "width" && value === 1)));
  if (!key.hold) for (const name of OF_HOLD) delete key[name];
  layer.keys[index] = Object.keys(key).join() === "tap" ? key.tap : key;
}

// Moves the border between two zones to a share of the strip; all other borders stay.
export function moveBorder(layer, index, share) {
  const all = zones(layer), [low, high] = [all[index].low, all[index + 1].high];
  const least = Math.min(LEAST_SHARE, (high - low) / 2);
  const at = Math.min(Math.max(share, low + least), high - least);
  const whole = layer.keys.reduce((sum, key) => sum + (table(key).width ?? 1), 0);
  const first = rounded((at - low) * whole), both = rounded((high - low) * whole);
  change(layer, index, { width: first });
  change(layer, index + 1, { width: rounded(both - first) });
}

export function split(layer, index) {
  const half = rounded((table(layer.keys[index]).width ?? 1) / 2);
  layer.keys.splice(index + 1, 0, {});
  change(layer, index, { width: half });
  change(layer, index + 1, { width: half });
}

function rounded(width) {
  return Math.max(Number(width.toFixed(4)), 0.0001);
}

// Calls `visit(table, name)` for each action of a layout. `none` is the value of an element without one.
function eachAction(content, visit) {
  for (const layer of content.layer) {
    for (const name of Object.keys(SWIPES)) if (layer[name]) visit(layer, name);
    layer.keys.forEach((key, i) => {
      if (typeof key === "string") visit(layer.keys, i, {});
      else for (const name of Object.keys(SLOTS)) if (key[name]) visit(key, name);
    });
  }
  for (const dance of Object.values(content.tap_dance ?? {})) {
    for (const some of [dance.actions, dance.holds ?? []]) some.forEach((_, i) => visit(some, i, ""));
  }
  for (const morph of Object.values(content.mod_morph ?? {})) for (const name of ["action", "morphed"]) visit(morph, name, "");
}

// Renames a tap dance or mod-morph, if no other one has the name. With an empty name, removes it and all
// actions that use it.
export function renameTable(content, kind, before, name) {
  if (name in content[kind]) return;
  if (name) content[kind] = Object.fromEntries(Object.entries(content[kind]).map(([one, table]) => [one === before ? name : one, table]));
  else delete content[kind][before];
  if (!Object.keys(content[kind]).length) delete content[kind];
  replace(content, (action) => (action !== `${kind} ${before}` ? action : name && `${kind} ${name}`));
}

// Sets the action of a tap dance for a hold after `i` + 1 taps.
export function setHold(dance, i, action) {
  const holds = Array.from({ length: Math.max(dance.holds?.length ?? 0, i + 1) }, (_, k) => dance.holds?.[k] ?? "");
  holds[i] = action;
  while (holds.length && !holds.at(-1)) holds.pop();
  if (holds.length) dance.holds = holds;
  else delete dance.holds;
}

// Adds a modifier to `mods` or `keep_mods` of a mod-morph, or removes it.
export function setModifier(morph, part, modifier, on) {
  morph[part] = [...(morph[part] ?? []).filter((one) => one !== modifier), ...(on ? [modifier] : [])];
  if (morph.keep_mods) morph.keep_mods = morph.keep_mods.filter((one) => morph.mods.includes(one));
  if (!morph.keep_mods?.length) delete morph.keep_mods;
}

// Replaces each action of a layout by `by(action)`; an empty text removes it.
function replace(content, by) {
  eachAction(content, (where, slot, none) => {
    const action = by(where[slot]);
    if (action || none !== undefined) where[slot] = action || none;
    else delete where[slot];
  });
}

// Renames a layer. With an empty name, removes the layer and all actions that switch to it.
export function renameLayer(content, index, name) {
  const before = content.layer[index].name;
  replace(content, (action) => {
    const [verb, of] = action.split(/ (.*)/);
    return !LAYER_VERBS.includes(verb) || of !== before ? action : name && `${verb} ${name}`;
  });
  if (name) content.layer[index].name = name;
  else content.layer.splice(index, 1);
}
