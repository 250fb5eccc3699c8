// Fields of settings. Their words are defined here; bounds and default values are in the server's schema.
import { field, sliderField } from "../controls.js";
import { make } from "../dom.js";

// For each number: words, unit, upper end of the slider, and step of the slider.
const NUMBERS = {
  hold_ms: ["Without readings, keep the last state for", "ms", 1000, 5], release_ms: ["Without light, a touch ends after", "ms", 200, 1],
  rate_hz: ["States per second", "Hz", 500, 5],
  rest_percent: ["Rest", "% of the strip", 100, 0.5], min_percent: ["Low end", "% of the strip", 100, 0.5], max_percent: ["High end", "% of the strip", 100, 0.5],
  rest_mN: ["No deflection up to", "mN", 12000, 50], max_mN: ["Full deflection from", "mN", 12000, 50],
  deadband: ["Deadband", "", 0.9, 0.01], expo: ["Expo, finer near rest", "", 1, 0.01],
  min_cutoff_hz: ["Filter: cutoff at rest", "Hz", 20, 0.1], beta: ["Filter: increase with speed", "Hz", 100, 0.5],
  derivative_cutoff_hz: ["Filter: cutoff of the speed", "Hz", 50, 0.5],
  number: ["Number", "", 16, 1], from_percent: ["Zone from", "% of the strip", 100, 0.5], to_percent: ["Zone to", "% of the strip", 100, 0.5],
  press_mN: ["Press from", "mN", 12000, 50], release_mN: ["Release below", "mN", 12000, 50],
  longest_ms: ["Longest touch", "ms", 1000, 5], pulse_ms: ["Button is down for", "ms", 500, 5],
  least_confidence: ["Least confidence that presses a key", "", 1, 0.01],
};

// Returns the values of a table; missing values get the default values of its struct in the schema.
export function complete(schema, struct, table) {
  const defaults = Object.entries(schema[struct].properties).filter(([, one]) => "default" in one);
  return { ...Object.fromEntries(defaults.map(([name, one]) => [name, one.default])), ...table };
}

// Returns the fields of a struct in the schema: {root, show(values)}. `onValue(name, value, replace)` is
// called with each new value; for `replace` see `sliderField`.
export function fieldsOf(schema, struct, onValue, prefix = "", without = []) {
  const all = Object.entries(schema[struct].properties).flatMap(([name, one]) => {
    if (without.includes(name)) return [];
    if (one.type === "boolean") {
      const box = make("input");
      box.type = "checkbox";
      box.ariaLabel = `${prefix}Invert`;
      box.addEventListener("change", () => onValue(name, box.checked));
      return [[name, { root: field(box, "Invert"), show: (value) => { box.checked = value; } }]];
    }
    if (!NUMBERS[name]) return [];
    const [words, unit, top, step] = NUMBERS[name];
    const sizes = { low: one.minimum, high: one.maximum, top, step, digits: step < 1 ? 2 : 0, prefix };
    return [[name, sliderField(words, unit, sizes, (value, replace) => onValue(name, value, replace))]];
  });
  return {
    root: make("div", "fields", ...all.map(([, one]) => one.root)),
    show: (values) => { for (const [name, one] of all) one.show(values[name]); },
  };
}

export function choice(prefix, words, options, onValue) {
  const select = make("select", "", ...Object.entries(options).map(([value, text]) => new Option(text, value)));
  select.ariaLabel = prefix + words;
  select.addEventListener("change", () => onValue(select.value));
  return { root: field(select, words), show: (value) => { select.value = value; } };
}
