// Controls of the editors: buttons, fields, and numbers with a slider.
import { make } from "./dom.js";

export function button(words, onClick) {
  const one = make("button", "", words);
  one.type = "button";
  one.addEventListener("click", onClick);
  return one;
}

export function text(words) {
  const one = make("input");
  one.ariaLabel = words;
  one.autocomplete = "off";
  one.maxLength = 60;
  return one;
}

export function number(words) {
  const one = text(words);
  one.type = "number";
  one.step = "any";
  return one;
}

export function field(input, words = input.ariaLabel) {
  return make("label", "", make("span", "", words), input);
}

// Shows a value in a field, unless somebody is typing in the field.
export function put(input, value, always = false) {
  if (always || input.value === value) input.value = value;
  else if (document.activeElement !== input || !input.matches(":focus-visible")) input.value = value;
}

// A field for a number, with a slider. `onValue(value, replace)` is called with each value. While the
// slider moves, `replace` is true for all values but the first: they are one step of undo.
export function sliderField(words, unit, { low, high, top = high, step = 1, digits = 0, prefix = "" }, onValue) {
  const shown = `${words}${unit && `, ${unit}`}`, exact = number(prefix + shown), slider = make("input");
  slider.type = "range";
  slider.ariaLabel = `${prefix}${words}, slider`;
  Object.assign(slider, { min: Math.floor(low / step) * step, max: Math.min(high, top), step });
  Object.assign(exact, { min: low, max: high, step: digits ? "any" : 1 });
  let moving = false;
  const take = (input, replace) => {
    const value = Math.min(Math.max(Number(Number(input.value).toFixed(digits)), low), high);
    onValue(value, replace);
    put(exact, String(value), true);
  };
  exact.addEventListener("change", () => take(exact, false));
  slider.addEventListener("input", () => { take(slider, moving); moving = true; });
  slider.addEventListener("change", () => { moving = false; });
  return {
    root: make("div", "tune", field(exact, shown), slider),
    show: (value) => { put(exact, String(value)); if (document.activeElement !== slider) slider.value = value; },
    disable: (off) => { exact.disabled = slider.disabled = off; },
  };
}
