// An editor of settings.
import { editing } from "../editing.js";

export function settingsEditing(root, opener, path, chooser, options) {
  return editing(root, opener, {
    path, store: "save", words: { push: "Save", chooser },
    state: (it, changed) => (it.stored === null ? "no board is connected: plug one in to save"
      : changed || !it.stored ? `not in ${it.file} yet` : `saved in ${it.file}`),
    ...options,
  });
}
