// A five-bar linkage: bars, end point with its error ellipse, and path of the end point.
// The message is described in docs/page.md.
import { canvas, colours, make } from "../dom.js";

const HEIGHT = 380, MARGIN = 24, ERRORS = 3;

export function twin(root) {
  let paint = null;
  const words = root.appendChild(make("p", "remark"));
  // The range of all points drawn so far: it only grows, so that the picture does not move.
  const box = { left: Infinity, right: -Infinity, low: Infinity, high: -Infinity };

  return (state, news) => {
    const it = news.twin;
    if (it === undefined) return;
    root.hidden = it === null;
    if (it === null) return;
    words.textContent = it.note ?? "";
    paint ??= canvas(root, HEIGHT);
    paint((c, width, height) => draw(c, width, height, it, box));
  };
}

function draw(c, width, height, it, box) {
  const bars = outline(it);
  const points = [...bars.flat(), ...(it.trail ?? []), [it.x_mm, it.y_mm]].filter(([x]) => x !== null);
  if (!points.length) return;
  for (const [x, y] of points) {
    box.left = Math.min(box.left, x);
    box.right = Math.max(box.right, x);
    box.low = Math.min(box.low, y);
    box.high = Math.max(box.high, y);
  }
  const { left, right, low, high } = box;
  const scale = Math.min((width - 2 * MARGIN) / (right - left || 1), (height - 2 * MARGIN) / (high - low || 1));
  const at = ([x, y]) => [
    width / 2 + (x - (left + right) / 2) * scale,
    height / 2 - (y - (low + high) / 2) * scale,
  ];
  c.lineJoin = c.lineCap = "round";
  const line = (path, colour, thick) => {
    c.strokeStyle = colour;
    c.lineWidth = thick;
    c.beginPath();
    path.forEach((point) => c.lineTo(...at(point)));
    c.stroke();
  };
  for (const bar of bars) {
    line(bar, colours.quiet, 5);
    c.fillStyle = colours.text;
    for (const joint of [bar[0], bar.at(-1)]) {
      c.beginPath();
      c.arc(...at(joint), 6, 0, 7);
      c.fill();
    }
  }
  if (it.trail?.length) line(it.trail, colours.force, 2);
  if (it.x_mm === null) return;
  const [x, y] = at([it.x_mm, it.y_mm]);
  if (it.cov) {
    const [xx, xy, yy] = it.cov;
    const middle = (xx + yy) / 2, half = Math.hypot((xx - yy) / 2, xy);
    c.beginPath();
    c.ellipse(x, y, ERRORS * scale * Math.sqrt(middle + half),
      ERRORS * scale * Math.sqrt(Math.max(middle - half, 0)), -Math.atan2(2 * xy, xx - yy) / 2, 0, 7);
    c.strokeStyle = colours.place;
    c.lineWidth = 1.5;
    c.stroke();
  }
  c.fillStyle = colours.place;
  c.beginPath();
  c.arc(x, y, 5, 0, 7);
  c.fill();
}

// Corners from joint 1 over the elbows to joint 2, if the lengths are known. Angles are measured
// from +y towards the other joint.
function outline({ x_mm, y_mm, theta1_rad: a, theta2_rad: b, base_mm, bar_mm }) {
  if (!base_mm || !bar_mm || x_mm === null) return [];
  const [inner1, , , inner2] = bar_mm;
  return [[
    [0, 0], [inner1 * Math.sin(a), inner1 * Math.cos(a)], [x_mm, y_mm],
    [base_mm - inner2 * Math.sin(b), inner2 * Math.cos(b)], [base_mm, 0],
  ]];
}
