// The editor of the controller's settings: each axis with its curve, and the signal that the draft gives.
import { button } from "../controls.js";
import { canvas, colours, make, placed } from "../dom.js";
import { choice, complete, fieldsOf } from "../settings/fields.js";
import { settingsEditing } from "../settings/engine.js";
import { deflection, oneEuro, range, shaped } from "../settings/axis.js";

// Length of a strip without a calibration; time that a chart shows; number of stored points; pause after
// which the filter starts again; height and margin of a chart in px.
const USUAL_LENGTH_UM = 85000, SPAN_S = 5, KEPT = 512, FORGET_S = 1, HEIGHT = 150, PAD = 18;
const STRUCTS = { position: "PositionAxis", force: "ForceAxis", pressed: "Pressed", tapped: "Tapped" };
const SOURCES = { "": "not used", position: "the position", force: "the force" };
const WHENS = { pressed: "a press", tapped: "a tap" };

export function controller(root) {
  let schema = null, length_um = USUAL_LENGTH_UM, axes = {}, now = {};
  const engine = settingsEditing(root, document.getElementById("edit-controller"), "controller", "Controller settings to import", {
    first: (it) => { schema = it.schema; lay(); }, refresh,
  });
  const { draft, edit } = engine;
  const cards = make("div", "cards"), buttons = make("div", "cards"), common = make("fieldset", "", make("legend", "", "Times"));
  const add = button("Add a button", () => edit((it) => {
    const used = (it.button ?? []).map((one) => one.number);
    it.button = [...(it.button ?? []), { number: Math.min(1 + Math.max(0, ...used), 16), when: "pressed", press_mN: 2000 }];
  }));
  root.append(make("div", "head", make("h2", "", "Controller settings"), engine.undo, engine.redo),
    engine.state, engine.foot, cards, buttons, make("div", "buttons", add), common, engine.ask);

  let times = null;
  function lay() {
    times = fieldsOf(schema, "ControllerSettings", (name, value, replace) => edit((it) => { it[name] = value; }, replace));
    common.append(times.root);
    axes = Object.fromEntries(["x", "y", "z"].map((name) => [name, axisCard(name)]));
    cards.replaceChildren(...Object.values(axes).map((one) => one.root));
  }

  function axisCard(name) {
    const title = `${name.toUpperCase()}: `, sources = name === "z" ? { "": SOURCES[""], force: SOURCES.force } : SOURCES;
    const source = choice(title, "follows", sources, (from) => edit((it) => { if (from) it[name] = { from }; else delete it[name]; }));
    const pictures = make("div", "pictures"), body = make("div"), filter = oneEuro(), points = [];
    const figures = ["curve", "signal"].map((kind) => {
      const box = make("figure", "", make("figcaption", "", kind === "curve" ? "axis value over measured value" : "last 5 s: measured (grey), axis (red)"));
      box.role = "img";
      return { box, paint: canvas(box, HEIGHT) };
    });
    pictures.append(...figures.map((one) => one.box));
    let shown = "", fields = [], last_s = null, raw = null;
    return {
      root: make("fieldset", "card", make("legend", "", `Axis ${name.toUpperCase()}`), source.root, pictures, body),
      show: (axis) => {
        source.show(axis?.from ?? "");
        pictures.hidden = body.hidden = !axis;
        if (!axis) { shown = ""; return; }
        if (shown !== axis.from) {
          shown = axis.from;
          points.length = 0;
          const of = (values) => (field, value, replace) => edit((it) => { values(it)[field] = value; }, replace);
          fields = [fieldsOf(schema, STRUCTS[axis.from], of((it) => it[name]), title, name === "z" ? ["invert"] : []),
            fieldsOf(schema, "Smooth", of((it) => (it[name].smooth ??= {})), title)];
          body.replaceChildren(...fields.map((one) => one.root));
        }
        fields[0].show(axis);
        fields[1].show(axis.smooth);
      },
      // Adds a reading, and the value that the draft computes for the axis.
      take: (axis, touch) => {
        const { name: field, rest, low, high } = range(axis, length_um);
        if (!placed(touch) || touch[field] === null) {
          filter.reset();
          last_s = raw = null;
          if (touch) points.push([touch.time_s, null, 0]);
        } else {
          const dt_s = last_s === null ? 0 : touch.time_s - last_s;
          if (dt_s > FORGET_S || dt_s < 0) filter.reset();
          last_s = touch.time_s;
          raw = touch[field];
          const u = deflection(raw, rest, low, high);
          points.push([touch.time_s, u, shaped(filter.take(u, dt_s, axis.smooth), axis)]);
        }
        if (points.length > KEPT) points.splice(0, KEPT / 4);
      },
      paint: (axis) => {
        const spanned = range(axis, length_um), force = axis.from === "force", out = points.at(-1)?.[2] ?? 0;
        const end = force ? 1.2 * axis.max_mN : length_um, ends = force ? ["0 N", `${(end / 1000).toFixed(1)} N`] : ["0 mm", `${(end / 1000).toFixed(0)} mm`];
        figures[0].box.ariaLabel = `Curve of axis ${name.toUpperCase()}${raw === null ? "" : `, now ${out.toFixed(2)}`}`;
        figures[0].paint((c, width) => curve(c, width, axis, spanned, end, ends, raw, out));
        figures[1].box.ariaLabel = `Signal of axis ${name.toUpperCase()}`;
        figures[1].paint((c, width) => signal(c, width, points));
      },
    };
  }

  // The cards of the buttons. If the kind of a button changes, its card is made again.
  const kept = [];
  function buttonCard(i) {
    const change = (mutate, replace) => edit((it) => mutate(it.button[i], it), replace);
    const title = `Button ${i + 1}: `, body = make("div");
    const when = choice(title, "pressed by", WHENS, (kind) => change((one, it) => {
      const { number, from_percent, to_percent } = one;
      it.button[i] = JSON.parse(JSON.stringify({ number, when: kind, from_percent, to_percent }));
    }));
    const remove = button(`Remove button ${i + 1}`, () => change((_, it) => it.button.splice(i, 1)));
    let shown = "", fields = null;
    return {
      root: make("fieldset", "card", make("legend", "", `Button ${i + 1}`), when.root, body, make("div", "buttons", remove)),
      show: (one) => {
        when.show(one.when);
        if (shown !== one.when) {
          shown = one.when;
          fields = fieldsOf(schema, STRUCTS[one.when], (name, value, replace) => change((it) => { it[name] = value; }, replace), title);
          body.replaceChildren(fields.root);
        }
        fields.show(one);
      },
    };
  }

  function refresh({ content }) {
    times.show(complete(schema, "ControllerSettings", content));
    now = {};
    for (const [name, card] of Object.entries(axes)) {
      if (content[name]) {
        now[name] = complete(schema, STRUCTS[content[name].from], content[name]);
        now[name].smooth = complete(schema, "Smooth", content[name].smooth);
      }
      card.show(now[name]);
      if (now[name]) card.paint(now[name]);
    }
    const list = content.button ?? [];
    while (kept.length < list.length) kept.push(buttonCard(kept.length));
    const roots = kept.slice(0, list.length).map((one) => one.root);
    if (roots.length !== buttons.children.length) buttons.replaceChildren(...roots);
    list.forEach((one, i) => kept[i].show(complete(schema, STRUCTS[one.when], one)));
  }

  return (shown, changes) => {
    if ("board" in changes) length_um = changes.board?.length_um ?? USUAL_LENGTH_UM;
    if ("controller" in changes || "may_command" in changes || "board" in changes) engine.take(shown.controller, shown.may_command);
    if (root.hidden) return;
    for (const [name, axis] of Object.entries(now)) {
      for (const touch of changes.touches) axes[name].take(axis, touch);
      if ("touch" in changes && !shown.touch) axes[name].take(axis, null);
      axes[name].paint(axis);
    }
    [...buttons.children].forEach((one, i) => {
      const { number } = draft.value.content.button[i];
      one.classList.toggle("lit", shown.stick?.buttons[number - 1] ?? false);
    });
  };
}

function frame(c, width, left, right) {
  c.strokeStyle = colours.edge;
  c.lineWidth = 1;
  c.beginPath();
  for (const v of [-1, 0, 1]) {
    c.moveTo(0, Math.round(y(v)) + 0.5);
    c.lineTo(width, Math.round(y(v)) + 0.5);
  }
  c.stroke();
  c.font = "12px -apple-system, 'Segoe UI', Roboto, 'Helvetica Neue', Arial, sans-serif";
  c.fillStyle = colours.quiet;
  c.textAlign = "left";
  c.fillText(left, 0, HEIGHT - 4);
  c.textAlign = "right";
  c.fillText(right, width, HEIGHT - 4);
  c.fillText("+1", width, y(1) + 13);
  c.fillText("−1", width, y(-1) - 4);
  c.lineWidth = 2;
  c.lineJoin = "round";
}

function y(v) {
  return PAD / 2 + ((HEIGHT - 2 * PAD) * (1 - v)) / 2;
}

function curve(c, width, axis, { rest, low, high }, end, ends, raw, out) {
  frame(c, width, ...ends);
  const x = (value) => (width * Math.min(Math.max(value, 0), end)) / end;
  // The deadband: the values of the strip at which the axis is 0.
  const from = Number.isFinite(low) ? rest - axis.deadband * (rest - low) : 0, to = rest + axis.deadband * (high - rest);
  c.fillStyle = colours.faint;
  c.fillRect(x(from), y(1), Math.max(x(to) - x(from), 1), y(-1) - y(1));
  c.strokeStyle = colours.force;
  c.beginPath();
  for (let i = 0; i <= 100; i++) {
    const value = (i * end) / 100;
    c.lineTo(x(value), y(axisValue(value, axis, rest, low, high)));
  }
  c.stroke();
  if (raw === null) return;
  c.fillStyle = colours.quiet;
  c.fillRect(Math.round(x(raw)), y(1), 1, y(-1) - y(1));
  c.fillStyle = colours.place;
  c.beginPath();
  c.arc(x(raw), y(out), 6, 0, 7);
  c.fill();
}

// Returns the value of an axis, -1 to 1. An axis that follows the force is 0 below its rest.
function axisValue(value, axis, rest, low, high) {
  return shaped(deflection(value, rest, low, high), axis);
}

function signal(c, width, points) {
  frame(c, width, `−${SPAN_S} s`, "now");
  const end_s = points.at(-1)?.[0] ?? 0;
  [[1, colours.quiet], [2, colours.place]].forEach(([column, colour]) => {
    c.strokeStyle = colour;
    c.beginPath();
    let drawing = false;
    for (const point of points) {
      const x = width * (1 - (end_s - point[0]) / SPAN_S), v = point[column];
      if (x < 0 || v === null) { drawing = false; continue; }
      if (drawing) c.lineTo(x, y(v));
      else c.moveTo(x, y(v));
      drawing = true;
    }
    c.stroke();
  });
}
