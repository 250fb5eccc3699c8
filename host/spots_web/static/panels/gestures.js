// The keys of the gestures of a worn strip, and the confidence of each gesture.
import { make } from "../dom.js";
import { actionField, matches, readUsages } from "../layout/actions.js";
import { complete, fieldsOf } from "../settings/fields.js";
import { settingsEditing } from "../settings/engine.js";

export function gestures(root) {
  let usages = [], rows = {}, limit = null, schema = null;
  const engine = settingsEditing(root, document.getElementById("edit-gestures"), "gestures", "Gestures file to import", {
    first: (it) => { schema = it.schema; lay(it.names); }, refresh,
  });
  const { draft, edit } = engine;
  const list = make("div", "sure-rows"), last = make("p", "place"), limits = make("div");
  last.role = "status";
  root.append(make("div", "head", make("h2", "", "Gestures"), engine.undo, engine.redo), engine.state, engine.foot, limits, last, list, engine.ask);

  const find = (typed) => matches(usages, null, typed);

  function lay(names) {
    limit = fieldsOf(schema, "GesturesFile", (name, value, replace) => edit((it) => { it[name] = value; }, replace));
    limits.replaceChildren(limit.root);
    rows = Object.fromEntries(names.map((name) => {
      const words = name.replace("_minus", " to sensor").replace("_plus", " away").replaceAll("_", " ");
      const bar = make("i"), tick = make("u"), meter = make("div", "sure", make("div", "whole", bar), tick), share = make("b", "", "–");
      meter.role = "meter";
      meter.ariaLabel = `Confidence of the last ${words}`;
      meter.ariaValueMin = meter.ariaValueNow = "0";
      meter.ariaValueMax = "100";
      const key = actionField(words, find, (action) => edit((it) => { if (action) it.gestures[name] = action; else delete it.gestures[name]; }));
      return [name, { words, bar, tick, meter, share, key, root: make("div", "sure-row", key.root, meter, share) }];
    }));
    list.replaceChildren(...Object.values(rows).map((one) => one.root));
  }

  function refresh({ content }) {
    if (!usages.length) readUsages().then((all) => { usages = all; engine.draw(); }, () => engine.fail("the names of the keys cannot be loaded: reload this window"));
    const { least_confidence } = complete(schema, "GesturesFile", content);
    limit.show({ least_confidence });
    for (const [name, { key, tick }] of Object.entries(rows)) {
      key.show(content.gestures[name] ?? "", usages.length);
      tick.style.left = `${100 * least_confidence}%`;
    }
  }

  return (shown, { events, ...changes }) => {
    if ("gestures" in changes || "may_command" in changes || "board" in changes) engine.take(shown.gestures, shown.may_command);
    if (root.hidden || !draft.value) return;
    const { content } = draft.value, { least_confidence } = complete(schema, "GesturesFile", content);
    for (const event of events) {
      const row = event.kind === "gesture" && rows[event.name];
      if (!row) continue;
      const sure = event.confidence >= least_confidence, key = content.gestures[event.name], percent = Math.round(100 * event.confidence);
      for (const one of Object.values(rows)) one.root.classList.toggle("last", one === row);
      row.bar.style.transform = `translateX(${percent - 100}%)`;
      row.meter.classList.toggle("unsure", !sure);
      row.meter.ariaValueNow = String(percent);
      row.share.textContent = `${percent} %`;
      last.textContent = `${row.words}, ${percent} % sure: ${!key ? "has no key" : sure ? `presses ${key}` : `presses nothing, because this is below ${Math.round(100 * least_confidence)} %`}`;
    }
    if (!last.textContent) last.textContent = "Make a gesture on the strip to see its confidence.";
  };
}
