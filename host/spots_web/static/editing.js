// Editor of a TOML file: draft with undo, checks by the server, questions before something is lost,
// import and export. Only a browser with the token shows it. The server checks and stores each text.
import { button } from "./controls.js";
import { make } from "./dom.js";
import { makeDraft } from "./layout/draft.js";
import { request } from "./request.js";

const CHECK_MS = 250;  // pause between the last change and the check

// `opener`: the button that opens the panel. `path`: path of the requests. `store`: name of the request
// that stores the file. `it`: the part of the state that describes the file, from the server.
// `state(it, changed, loses)` returns the state of the draft in words. `refresh` draws the draft.
// `checked(answer)` is called with each answer to a check. `paused` returns whether a check must wait. `first(it)` is called for the first `it`.
//
// A draft is {content, text, agreed}. `text` is the text of an imported or new file; without it, the
// draft is a change of the file on the server, which writes the text of each draft. `agreed` is the
// number of comments that may be lost.
export function editing(root, opener, { path, store, words, refresh, first, state: stateOf, paused = () => false, shown = () => {}, checked = () => {} }) {
  const OPEN = `spots-editing-${path}`, closed = opener.textContent;
  // `problem`: why the draft is invalid. `failure`: why the last request failed.
  let it = null, may = false, open = false, problem = "", failure = "", news = "", loses = [];
  let checking = 0, asked = 0, busy = false, changed = false;
  const draft = makeDraft(`spots-${path}`, () => { news = failure = ""; draw(); check(); });

  const undo = button("Undo", () => draft.undo()), redo = button("Redo", () => draft.redo());
  undo.ariaKeyShortcuts = "Control+Z";
  redo.ariaKeyShortcuts = "Control+Shift+Z";
  const state = make("p", "state"), ask = make("dialog", "ask");
  state.role = "status";
  const push = button(words.push, () => send());
  push.className = "main";
  const chooser = make("input");
  chooser.type = "file";
  chooser.accept = ".toml";
  chooser.ariaLabel = words.chooser;
  chooser.hidden = true;
  const foot = make("div", "buttons foot", push, button("Import…", () => chooser.click()), button("Export", download), chooser);

  root.addEventListener("keydown", (event) => {
    const undoes = (event.ctrlKey || event.metaKey) && event.key.toLowerCase() === "z";
    const redoes = (event.ctrlKey && event.key.toLowerCase() === "y") || (undoes && event.shiftKey);
    if (event.target.matches("input:not([type=range])") || !(undoes || redoes)) return;
    event.preventDefault();
    (redoes ? draft.redo : draft.undo)();
  });
  // At most one editor is open.
  opener.addEventListener("click", () => setOpen(!open));
  document.addEventListener("editing", ({ detail }) => { if (detail !== path && open) setOpen(false); });
  function setOpen(on) {
    open = on;
    if (on) document.dispatchEvent(new CustomEvent("editing", { detail: path }));
    try { sessionStorage.setItem(OPEN, open ? "1" : ""); } catch { /* not stored: the editor is closed after a reload */ }
    show();
  }
  try { open = Boolean(sessionStorage.getItem(OPEN)); } catch { /* nothing is stored: the editor stays closed */ }

  function draw() {
    if (!draft.value || !it || root.hidden) return;
    undo.disabled = !draft.canUndo;
    redo.disabled = !draft.canRedo;
    refresh(draft.value, it);
    showState();
  }

  function showState() {
    if (!it) return;
    changed = Boolean(draft.value) && !same(draft.value.content, it.content);
    const text = problem || failure || news || stateOf(it, changed, loses);
    if (state.textContent !== text) state.textContent = text;
    const stored = it.stored === true || it.stored === "this";
    state.dataset.kind = problem || failure ? "bad" : changed || !stored ? "new" : "good";
    push.disabled = Boolean(problem) || busy || it.stored === null || !(changed || !stored);
    shown(it, may, busy);
  }

  async function post(message) {
    busy = true;
    showState();
    const answer = await request(path, message);
    busy = false;
    showState();
    return answer;
  }

  // The server checks the draft shortly after the last change.
  function check() {
    clearTimeout(checking);
    if (!draft.value || !it || !may || !open || paused()) return;
    checking = setTimeout(async () => {
      const number = ++asked;
      const answer = await request(path, checkOf(draft.value));
      if (number !== asked || answer.unanswered) return;
      problem = answer.refused ?? "";
      loses = answer.loses ?? [];
      checked(answer);
      showState();
    }, CHECK_MS);
  }

  function checkOf({ content, text }) {
    return { do: "check", content, ...(text !== undefined && { text }) };
  }

  async function send() {
    const { base } = it, text = await written(words.push);
    if (text === null) return;
    const message = { do: store, text, base, ...(store === "push" && { loses: [], texts: [] }) };
    let answer = await post(message);
    const { loses: lost = [], texts = [] } = answer, questions = [];
    if (lost.length) questions.push(`With this layout, no key types: ${listed(lost)}.`);
    if (texts.length) questions.push(`A touch types each of these texts, commands too: ${texts.map((one) => `‘${one}’`).join(", ")}.`);
    for (const one of questions) if (!(await question(one, "Put it on the board"))) return;
    if (questions.length) answer = await post({ ...message, loses: lost, texts });
    failure = answer.refused ?? "";
    news = answer.note ? `on the board: ${answer.note}` : "";
    showState();
  }

  // Returns the text of the draft, which the server writes; null if there is none, or if the user does
  // not agree that comments are lost. `go` is the button that does it nevertheless.
  async function written(go) {
    const value = draft.value, { text, lost, refused } = await post(checkOf(value));
    if (refused) {
      failure = refused;
      showState();
      return null;
    }
    if (lost <= (value.agreed ?? 0)) return text;
    const count = lost === 1 ? "1 comment" : `${lost} comments`;
    if (!(await question(`${count} of the file will be lost.`, go))) return null;
    draft.set({ ...value, agreed: lost }, true);
    return text;
  }

  async function download() {
    const text = await written("Export");
    if (text === null) return;
    const link = make("a");
    link.href = URL.createObjectURL(new Blob([text], { type: "application/toml" }));
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
    else draft.set({ content: answer.content, text });
    showState();
  });

  function question(text, yes) {
    return new Promise((done) => {
      const finish = (answer) => () => { ask.close(answer); };
      ask.replaceChildren(make("p", "", text), make("div", "buttons", button(yes, finish("yes")), button("Cancel", finish(""))));
      ask.ariaLabel = text;
      ask.onclose = () => done(ask.returnValue === "yes");
      ask.returnValue = "";
      ask.showModal();
    });
  }

  function show() {
    const was = root.hidden;
    opener.hidden = !it || !may;
    root.hidden = !it || !may || !open;
    opener.textContent = open ? "close" : closed;
    opener.setAttribute("aria-expanded", String(!root.hidden));
    if (!root.hidden) document.body.dataset.editing = path;
    else if (!was || document.body.dataset.editing === path) document.body.dataset.editing = "off";
    if (!it) return;
    showState();
    if (root.hidden) return;
    draw();
    check();
  }

  return {
    draft, undo, redo, state, ask, foot, post, check, draw, setOpen,
    // Changes the content of the draft, as one step of undo; with `replace`, as part of the last step.
    edit: (mutate, replace = false) => {
      const value = draft.value;
      mutate(value.content);
      draft.set(value, replace);
    },
    get changed() { return changed; },
    say: (text) => { news = text; showState(); },
    fail: (text) => { failure = text; showState(); },
    // Uses a new state of the file from the server.
    take: (part, allowed) => {
      const before = it;
      it = part ?? null;
      may = Boolean(allowed);
      if (!before && it) first(it);
      // A changed file on the server becomes the draft; undo returns to the draft before it.
      if (it && may && draft.base !== it.base) {
        const { value } = draft, mine = value && !same(value.content, it.content);
        const edited = mine && !(before && same(value.content, before.content));
        draft.base = it.base;
        draft.set({ content: it.content }, !mine && Boolean(value));
        if (edited) news = `${it.file} was changed elsewhere, and this window shows it now; Undo brings your draft back`;
      }
      show();
    },
  };
}

export function listed(names) {
  return names.length > 8 ? `${names.slice(0, 7).join(", ")} and ${names.length - 7} others` : names.join(", ");
}

// Returns whether two contents are equal, whatever the order of their keys.
function same(a, b) {
  return canonical(a) === canonical(b);
}

function canonical(it) {
  const isTable = (part) => part !== null && typeof part === "object" && !Array.isArray(part);
  return JSON.stringify(it, (_, part) => (isTable(part) ? Object.fromEntries(Object.entries(part).sort(([a], [b]) => (a < b ? -1 : 1))) : part));
}
