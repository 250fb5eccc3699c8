// Panels of other packages. Each has a folder on the server, with a script and perhaps a style sheet.
import { make } from "./dom.js";
import { request } from "./request.js";

// Loads the panel that the server describes, and calls `add(draw, ...parts)` when it can be drawn. A
// panel that fails is replaced by a sentence; the rest of the page works without it.
export async function load({ name, title, fault, style }, add) {
  const part = `panel-${name}`, folder = `panels/${name}`, root = make("section", "wide plugin", make("h2", "", title));
  Object.assign(root, { id: part, ariaLabel: title, hidden: true });
  document.querySelector("main").append(root);

  function fail(why) {
    root.replaceChildren(make("h2", "", title), make("p", "remark", why));
    root.hidden = false;
  }
  const failed = (error) => fail(`the panel ‘${title}’ cannot be shown (${error.message ?? error}): update or remove its package`);

  if (fault) {
    fail(fault);
    return;
  }
  try {
    if (style) document.head.append(Object.assign(make("link"), { rel: "stylesheet", href: `${folder}/panel.css` }));
    const { panel } = await import(`../${folder}/panel.js`);
    const draw = panel(root, (body) => request(folder, JSON.stringify(body)));
    let ended = false;
    add((state, news, now_s) => {
      const value = state[part] ?? null;
      if (ended) return false;
      root.hidden = value === null;
      try {
        return value !== null && draw(value, state, now_s);
      } catch (error) {
        ended = true;
        failed(error);
        return false;
      }
    }, part, "may_command");
  } catch (error) {
    failed(error);
  }
}
