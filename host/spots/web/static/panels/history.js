// Contrast and force of the last seconds.
import { FULL_FORCE_MN, canvas, colours, make } from "../dom.js";

const SPAN_S = 10, KEPT = 2048, STALE_S = 1.5;
const HEIGHT = 228, TOP = 16, GAP = 26, EACH = (HEIGHT - TOP - GAP - 1) / 2;

export function history(root) {
  const layers = root.appendChild(make("div", "layers"));
  const paintScale = canvas(layers, HEIGHT), paintCurves = canvas(layers, HEIGHT);
  const points = [];
  let ahead_s = null;  // clock of the browser minus clock of the readings
  let heard_s = -Infinity;
  let low = Infinity, high = -Infinity;

  function take(touch, now_s) {
    // The shortest delay is the most accurate. A jump means that a clock has restarted.
    const offset = now_s - touch.time_s;
    if (ahead_s === null || Math.abs(offset - ahead_s) > STALE_S) {
      ahead_s = offset;
      points.length = 0;
    }
    ahead_s += (offset - ahead_s) * (offset < ahead_s ? 0.5 : 0.002);
    heard_s = now_s;
    points.push(touch);
    if (points.length > KEPT) points.splice(0, KEPT / 4);
    if (touch.touching) {
      low = Math.min(low, touch.contrast);
      high = Math.max(high, touch.contrast);
    }
  }

  return (state, { touches }, now_s) => {
    for (const touch of touches) take(touch, now_s);
    const room = Math.max((high - low) * 0.08, 0.02);
    const span = high > low ? [low - room, high + room] : [-1, 1];
    const unit = state.board?.relative_force ? "relative" : "N";
    const above = [...span.map(written), `${FULL_FORCE_MN / 1000}`, unit];
    paintScale((c, width) => {
      scale(c, width, TOP, "contrast, log₂", above[1], above[0]);
      scale(c, width, TOP + EACH + GAP, `force, ${unit}`, above[2], "");
    }, above.join());
    const end_s = ahead_s === null ? 0 : Math.min(now_s - ahead_s, (points.at(-1)?.time_s ?? 0) + STALE_S);
    paintCurves((c, width) => {
      const x = (time_s) => width * (1 - (end_s - time_s) / SPAN_S);
      curve(c, TOP, span, colours.place, (t) => t.contrast, x);
      curve(c, TOP + EACH + GAP, [0, FULL_FORCE_MN], colours.force, (t) => t.force_mN, x);
    });
    return now_s - heard_s < STALE_S;  // draw again until it stands still
  };

  function curve(c, top, [bottom, ceiling], colour, value, x) {
    const y = (v) => top + EACH * (1 - (Math.min(Math.max(v, bottom), ceiling) - bottom) / (ceiling - bottom));
    c.strokeStyle = colour;
    c.lineWidth = 2;
    c.lineJoin = c.lineCap = "round";
    c.beginPath();
    let drawing = false;
    for (const touch of points) {
      const at = x(touch.time_s);
      if (at < -20) continue;
      if (!touch.touching) { drawing = false; continue; }
      if (drawing) c.lineTo(at, y(value(touch)));
      else c.moveTo(at, y(value(touch)));
      drawing = true;
    }
    c.stroke();
  }
}

function scale(c, width, top, name, above, below) {
  c.strokeStyle = colours.edge;
  c.lineWidth = 1;
  c.beginPath();
  for (const share of [0, 0.5, 1]) {
    const line = Math.round(top + EACH * share) + 0.5;
    c.moveTo(0, line);
    c.lineTo(width, line);
  }
  c.stroke();
  c.font = "12px -apple-system, 'Segoe UI', Roboto, 'Helvetica Neue', Arial, sans-serif";
  c.fillStyle = colours.quiet;
  c.textBaseline = "alphabetic";
  c.textAlign = "left";
  c.fillText(name, 0, top - 5);
  c.textAlign = "right";
  c.fillText(above, width, top - 5);
  c.fillText(below, width, top + EACH - 5);
}

function written(value) {
  return value.toFixed(2).replace(/^-(?!0\.00)/, "−").replace("-", "");
}
