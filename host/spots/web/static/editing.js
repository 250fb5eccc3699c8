// Editor of a TOML file: draft with undo, checks by the server, questions before something is lost,
// import and export. Only a browser with the token shows it. The server checks and stores each text.
import { button } from "./controls.js";
import { make } from "./dom.js";
import { makeDraft } from "./layout/draft.js";
import { request } from "./request.js";

const CHECK_MS = 250;  // pause between the last change and the check

// `opener`: the button that opens the panel. `path`: path of the requests. `store`: name of the request
// that stores the file. `it`: the part of the state that describes the file, from the server.
// `begin(text, content)` returns a draft. `written(value, it)` returns {text, lost}: the text of a
// draft, and the number of comments that this text loses. `forget(value)` returns a draft without
// these comments. `state(it, changed, loses)` returns the state of the draft in words. `refresh` draws
// the draft. `paused` returns whether a check must wait. `first(it)` is called for the first `it`.
export function editing(root, opener, { path, store, words, begin, written, forget, refresh, first, state: stateOf, same, differs = () => {}, paused = () => false, shown = () => {} }) {
  const OPEN = `spots-editing-${path}`, closed = opener.textContent;
  let it = null, may = false, open = false, problem = "", news = "", loses = [];
  let checking = 0, asked = 0, busy = false, changed = false;
  const draft = makeDraft(`spots-${path}`, () => { news = ""; draw(); check(); });

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
    const text = problem || news || stateOf(it, changed, loses);
    if (state.textContent !== text) state.textContent = text;
    const stored = it.stored === true || it.stored === "this";
    state.dataset.kind = problem ? "bad" : changed || !stored ? "new" : "good";
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
      const number = ++asked, value = draft.value;
      const answer = await request(path, { do: "check", text: written(value, it).text });
      if (number !== asked || answer.unanswered) return;
      problem = answer.refused ?? "";
      loses = answer.loses ?? [];
      showState();
      differs(value, answer);
    }, CHECK_MS);
  }

  async function send() {
    if (!(await mayLose(words.push))) return;
    const message = { do: store, text: written(draft.value, it).text, base: it.base, ...(store === "push" && { loses: [] }) };
    let answer = await post(message);
    if (answer.loses?.length) {
      if (!(await question(`With this layout, nothing types ${listed(answer.loses)} any more.`, "Put it on the board"))) return;
      answer = await post({ ...message, loses: answer.loses });
    }
    problem = answer.refused ?? "";
    news = answer.refused ? "" : answer.note ? `on the board: ${answer.note}` : "";
    showState();
  }

  // Asks the user before comments are lost.
  async function mayLose(go) {
    const value = draft.value, { lost } = written(value, it);
    if (!lost) return true;
    const count = lost === 1 ? "1 comment" : `${lost} comments`;
    if (!(await question(`${count} of the file will be lost${words.kept}.`, go))) return false;
    draft.set(forget(value));
    return true;
  }

  async function download() {
    if (!(await mayLose("Export"))) return;
    const link = make("a");
    link.href = URL.createObjectURL(new Blob([written(draft.value, it).text], { type: "application/toml" }));
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
    else draft.set(begin(text, answer.content));
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
    fail: (text) => { problem = text; showState(); },
    // Uses a new state of the file from the server.
    take: (part, allowed) => {
      const begins = !it;
      it = part ?? null;
      may = Boolean(allowed);
      if (begins && it) first(it);
      // A changed file on the server becomes the draft; undo returns to the draft before it.
      if (it && may && draft.base !== it.base) {
        if (!draft.value || !same(draft.value.content, it.content)) draft.set(begin(it.text, it.content));
        draft.base = it.base;
      }
      show();
    },
  };
}

export function listed(names) {
  return names.length > 8 ? `${names.slice(0, 7).join(", ")} and ${names.length - 7} more` : names.join(", ");
}
