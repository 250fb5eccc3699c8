// A five-bar linkage: bars, end point with its error ellipse, and path of the end point.
// docs/extend/web-messages.md describes the message.
import { canvas, colours, list, make } from "../../static/dom.js";

const MARGIN = 24, ERRORS = 3;  // px; size of the drawn error ellipse in standard errors

export function panel(root) {
  let paint = null;
  const words = make("p", "remark"), figures = make("dl", "figures"), picture = make("div", "picture");
  const legend = make("ul", "key-of", make("li", "path", "path"), make("li", "error", "three standard errors"));
  picture.role = "img";
  root.append(picture, make("div", "side", words, figures, legend));
  // The range of all points that were drawn. It only grows, so that the picture does not move.
  const box = { left: Infinity, right: -Infinity, low: Infinity, high: -Infinity };

  return (it) => {
    put(words, it.note ?? "");
    const known = it.x_mm !== null;
    const sigma = it.cov && known ? Math.sqrt(Math.max(it.cov[0], it.cov[2])) : null;
    list(figures, [
      ["x", known ? `${fixed(it.x_mm)} mm` : "–"],
      ["y", known ? `${fixed(it.y_mm)} mm` : "–"],
      ["joint 1", degrees(it.theta1_rad)],
      ["joint 2", degrees(it.theta2_rad)],
      ["standard error", sigma === null ? "–" : `${sigma.toFixed(2)} mm`],
    ]);
    picture.ariaLabel = known ? `The end point is at x ${it.x_mm.toFixed(0)} mm, y ${it.y_mm.toFixed(0)} mm` : "The position of the end point is unknown";
    paint ??= canvas(picture);
    paint((c, width, height) => draw(c, width, height, it, box));
  };
}

function put(element, text) {
  if (element.textContent !== text) element.textContent = text;
}

function fixed(value) {
  return value.toFixed(1).replace("-", "−");
}

function degrees(angle_rad) {
  return angle_rad === null || angle_rad === undefined ? "–" : `${fixed((180 * angle_rad) / Math.PI)}°`;
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

// Returns a list with one line: joint 1, elbow 1, end point, elbow 2, joint 2, in mm. The list is empty if
// lengths or position are unknown. Angles are measured from +y towards the other joint.
function outline({ x_mm, y_mm, theta1_rad: a, theta2_rad: b, base_mm, bar_mm }) {
  if (!base_mm || !bar_mm || x_mm === null) return [];
  const [inner1, , , inner2] = bar_mm;
  return [[
    [0, 0], [inner1 * Math.sin(a), inner1 * Math.cos(a)], [x_mm, y_mm],
    [base_mm - inner2 * Math.sin(b), inner2 * Math.cos(b)], [base_mm, 0],
  ]];
}
