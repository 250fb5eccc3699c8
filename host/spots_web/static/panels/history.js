// Position and force of the last 10 s, and the values at the pointer. Contrast is shown on request, and
// if the board has no calibration.
import { FULL_FORCE_MN, canvas, colours, make, several } from "../dom.js";

// Time that the charts show; number of stored readings; time without readings after which the curves
// stop; length of a strip without a calibration; step of the cursor; largest distance of a reading from it.
const SPAN_S = 10, KEPT = 2048, STALE_S = 1.5, USUAL_LENGTH_UM = 85000, STEP_S = 0.1, NEAR_S = 0.1;
const HEIGHT = 228, TOP = 18, GAP = 26, EACH = (HEIGHT - TOP - GAP - 1) / 2;

export function history(root) {
  const detail = make("button", "", "contrast");
  detail.type = "button";
  detail.setAttribute("aria-pressed", "false");
  detail.ariaLabel = "Show the contrast";
  const readout = make("output", "readout");
  root.prepend(make("div", "head", root.querySelector("h2"), readout, detail));
  const layers = root.appendChild(make("div", "layers"));
  layers.tabIndex = 0;
  layers.role = "slider";
  layers.ariaLabel = "Time of the values that are shown, in seconds before now";
  layers.ariaValueMin = String(-SPAN_S);
  layers.ariaValueMax = layers.ariaValueNow = "0";
  const paintScale = canvas(layers, HEIGHT), paintCurves = canvas(layers, HEIGHT);
  const points = [];
  let ahead_s = null;  // clock of the browser minus clock of the readings
  let heard_s = -Infinity, end_s = 0, length_um = USUAL_LENGTH_UM, unit = "N";
  let low = Infinity, high = -Infinity;
  let chosen = false, uncalibrated = false, back_s = null;  // back_s: how long before now the pointer's time is

  function take(touch, now_s) {
    // The smallest offset is the best one: delays of messages only enlarge it. A jump of the offset means
    // that a clock has restarted.
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

  detail.addEventListener("click", () => {
    chosen = !chosen;
    detail.setAttribute("aria-pressed", String(chosen));
    paint();
  });
  const look = (seconds) => {
    back_s = seconds === null ? null : Math.min(Math.max(seconds, 0), SPAN_S);
    paint();
  };
  const point = ({ clientX }) => {
    const { left, width } = layers.getBoundingClientRect();
    look(SPAN_S * (1 - (clientX - left) / width));
  };
  layers.addEventListener("pointermove", point);
  layers.addEventListener("pointerdown", point);
  layers.addEventListener("pointerleave", () => look(null));
  layers.addEventListener("blur", () => look(null));
  layers.addEventListener("keydown", ({ key }) => {
    const way = { ArrowLeft: STEP_S, ArrowRight: -STEP_S, PageUp: 1, PageDown: -1 }[key];
    if (way) look((back_s ?? 0) + way);
    if (key === "Escape") look(null);
  });

  // The reading at the pointer, if there is one within a tenth of a second.
  function found() {
    if (back_s === null) return null;
    const at_s = end_s - back_s;
    let best = null;
    for (const one of points) {
      if (!best || Math.abs(one.time_s - at_s) < Math.abs(best.time_s - at_s)) best = one;
    }
    return best && Math.abs(best.time_s - at_s) < NEAR_S ? best : null;
  }

  function say(touch) {
    if (back_s === null) return "";
    const when = `${back_s.toFixed(1)} s ago: `;
    if (several(touch)) return `${when}two fingers`;
    if (!touch?.touching) return when + (touch ? "no press" : "no reading");
    const place = touch.position_um === null ? "" : `${(touch.position_um / 1000).toFixed(2)} mm, `;
    const force = touch.force_mN === null ? "" : `${(touch.force_mN / 1000).toFixed(2)} ${unit}`;
    const contrast = chosen || uncalibrated ? `, contrast ${written(touch.contrast)}` : "";
    return when + (place + force + contrast).replace(/^, /, "");
  }

  function paint() {
    const contrast = chosen || uncalibrated;
    const room = Math.max((high - low) * 0.08, 0.02);
    const span = !contrast ? [0, length_um] : high > low ? [low - room, high + room] : [-1, 1];
    const ends = contrast ? span.map(written) : ["0", (length_um / 1000).toFixed(0)];
    paintScale((c, width) => {
      scale(c, width, TOP, contrast ? "contrast, log₂" : "position, mm", colours.place, ends[1], ends[0]);
      scale(c, width, TOP + EACH + GAP, `force, ${unit}`, colours.force, `${FULL_FORCE_MN / 1000}`, "0");
    }, [contrast, unit, ...ends].join());
    const at = found(), words = say(at);
    if (readout.textContent !== words) {
      readout.textContent = layers.ariaValueText = words;
      layers.ariaValueNow = (-(back_s ?? 0)).toFixed(1);
    }
    const value = contrast ? (t) => t.contrast : (t) => t.position_um;
    paintCurves((c, width) => {
      const x = (time_s) => width * (1 - (end_s - time_s) / SPAN_S);
      if (back_s !== null) {
        c.fillStyle = colours.quiet;
        c.fillRect(Math.round(x(end_s - back_s)), 0, 1, HEIGHT);
      }
      curve(c, TOP, span, colours.place, value, x, at);
      curve(c, TOP + EACH + GAP, [0, FULL_FORCE_MN], colours.force, (t) => t.force_mN, x, at);
    });
  }

  return (state, { touches, board }, now_s) => {
    if (board) {
      length_um = board.length_um ?? USUAL_LENGTH_UM;
      unit = board.relative_force ? "relative" : "N";
    }
    for (const touch of touches) take(touch, now_s);
    uncalibrated = Boolean(state.board?.id) && !state.board.length_um;
    detail.hidden = uncalibrated;
    end_s = ahead_s === null ? 0 : Math.min(now_s - ahead_s, (points.at(-1)?.time_s ?? 0) + STALE_S);
    paint();
    return now_s - heard_s < STALE_S;  // draw again while the curves move
  };

  function curve(c, top, [bottom, ceiling], colour, value, x, at) {
    const y = (v) => top + EACH * (1 - (Math.min(Math.max(v, bottom), ceiling) - bottom) / (ceiling - bottom));
    c.strokeStyle = c.fillStyle = colour;
    c.lineWidth = 2;
    c.lineJoin = c.lineCap = "round";
    c.beginPath();
    let drawing = false;
    for (const touch of points) {
      const to = x(touch.time_s);
      if (to < -20) continue;
      if (!touch.touching || several(touch) || value(touch) === null) { drawing = false; continue; }
      if (drawing) c.lineTo(to, y(value(touch)));
      else c.moveTo(to, y(value(touch)));
      drawing = true;
    }
    c.stroke();
    if (!at?.touching || several(at) || value(at) === null) return;
    c.beginPath();
    c.arc(x(at.time_s), y(value(at)), 5, 0, 7);
    c.fill();
  }
}

function scale(c, width, top, name, colour, above, below) {
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
  c.textBaseline = "alphabetic";
  c.textAlign = "left";
  c.fillStyle = colour;
  c.fillText(name, 0, top - 5);
  c.fillStyle = colours.quiet;
  c.textAlign = "right";
  c.fillText(above, width, top - 5);
  c.fillText(below, width, top + EACH - 5);
}

function written(value) {
  return value.toFixed(2).replace(/^-(?!0\.00)/, "−").replace("-", "");
}
