// Contrast and force over the last seconds.
import { FULL_FORCE_MN, canvas, colours } from "../dom.js";

const SPAN_S = 10, KEPT = 2048, STALE_S = 1.5, TOP = 16, GAP = 26;

export function history(root) {
  const paint = canvas(root, 228);
  const points = [];
  let ahead_s = null;  // of the page's clock over that of the readings
  let heard_s = -Infinity;
  let low = Infinity, high = -Infinity;

  return (state, news, now_s) => {
    const touch = news.touch;
    if (touch) {
      // The soonest arrival is nearest the truth; a clock that begins anew is followed.
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
    if (now_s - heard_s > STALE_S && !news.connection) return;  // it stands still
    const end_s = ahead_s === null ? 0 : Math.min(now_s - ahead_s, (points.at(-1)?.time_s ?? 0) + STALE_S);
    paint((c, width, height) => {
      const each = (height - TOP - GAP - 1) / 2;
      const room = Math.max((high - low) * 0.08, 0.02);
      const span = high > low ? [low - room, high + room] : [-1, 1];
      const x = (time_s) => width * (1 - (end_s - time_s) / SPAN_S);
      plot(c, "contrast", "log₂", TOP, each, width, span, colours.place, (t) => t.contrast, x);
      plot(c, "force", "N", TOP + each + GAP, each, width, [0, FULL_FORCE_MN], colours.force,
        (t) => t.force_mN, x);
    });
  };

  function plot(c, name, unit, top, height, width, [bottom, ceiling], colour, value, x) {
    const y = (v) => top + height * (1 - (Math.min(Math.max(v, bottom), ceiling) - bottom) / (ceiling - bottom));
    c.strokeStyle = colours.edge;
    c.lineWidth = 1;
    c.beginPath();
    for (const share of [0, 0.5, 1]) {
      const line = Math.round(top + height * share) + 0.5;
      c.moveTo(0, line);
      c.lineTo(width, line);
    }
    c.stroke();
    c.font = "12px -apple-system, 'Segoe UI', Roboto, 'Helvetica Neue', Arial, sans-serif";
    c.fillStyle = colours.quiet;
    c.textBaseline = "alphabetic";
    c.textAlign = "left";
    c.fillText(`${name}, ${unit}`, 0, top - 5);
    c.textAlign = "right";
    const [above, below] = name === "force" ? [`${ceiling / 1000}`, ""] : [ceiling, bottom].map(written);
    c.fillText(above, width, top - 5);
    c.fillText(below, width, top + height - 5);

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

function written(value) {
  return value.toFixed(2).replace(/^-(?!0\.00)/, "−").replace("-", "");
}
