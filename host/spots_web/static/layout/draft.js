// The file that is being edited, with undo and redo. It survives a reload of the window.

const MOST = 100, STORED_MAX = 500_000;  // steps of undo; characters that are stored for a reload

// `STORED` is the key of the draft in sessionStorage; `onChange` is called after each change.
export function makeDraft(STORED, onChange) {
  let past = [], future = [], now = null, base = null;  // texts of JSON
  const keep = () => {
    const text = JSON.stringify({ past, now, future, base });
    try {
      if (text.length < STORED_MAX) sessionStorage.setItem(STORED, text);
      else sessionStorage.removeItem(STORED);
    } catch { /* the browser stores nothing: a reload loses the draft */ }
  };
  const move = (from, to) => {
    if (!from.length) return;
    to.push(now);
    now = from.pop();
    keep();
    onChange();
  };
  try {
    ({ past, now, future, base } = JSON.parse(sessionStorage.getItem(STORED)) ?? { past, now, future, base });
  } catch { /* nothing is stored: there is no draft yet */ }

  return {
    get value() { return now === null ? null : JSON.parse(now); },
    // The checksum of the server's text from which the draft was made.
    get base() { return base; },
    set base(value) { base = value; keep(); },
    get canUndo() { return past.length > 0; },
    get canRedo() { return future.length > 0; },
    // With `replace`, the change belongs to the last step of undo, as when a border is dragged.
    set(value, replace = false) {
      const text = JSON.stringify(value);
      if (text === now) return;
      if (!replace && now !== null) past = [...past.slice(1 - MOST), now];
      if (!replace) future = [];
      now = text;
      keep();
      onChange();
    },
    undo: () => move(past, future),
    redo: () => move(future, past),
  };
}
