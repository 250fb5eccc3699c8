// An editor of settings. It changes single lines of the file, so that comments survive.
import { editing } from "../editing.js";
import { canonical, count, patched, written } from "../toml.js";

const same = (a, b) => canonical(a) === canonical(b);

export function settingsEditing(root, opener, path, chooser, options) {
  const textOf = ({ text, was, content, whole }) => (whole ? written(content) : same(was, content) ? text : patched(text, was, content));
  const engine = editing(root, opener, {
    path, store: "save", same, begin: (text, content) => ({ content, text, was: content }),
    words: { push: "Save", chooser, kept: "" },
    written: (value) => {
      const text = textOf(value);
      return { text, lost: value.agreed ? 0 : Math.max(count(value.text) - count(text), 0) };
    },
    forget: (value) => ({ ...value, agreed: true }),
    // If the server reads other values from the changed text, the whole file is written from its values.
    differs: (value, { content }) => {
      if (content && !value.whole && !same(content, value.content)) engine.draft.set({ ...value, whole: true }, true);
    },
    state: (it, changed) => (it.stored === null ? "no board is connected: plug one in to save"
      : changed || !it.stored ? `not in ${it.file} yet` : `saved in ${it.file}`),
    ...options,
  });
  return engine;
}
