// Returns a new element with a class, text and children.
export function make(tag, name = "", ...children) {
  const element = document.createElement(tag);
  if (name) element.className = name;
  element.append(...children);
  return element;
}

// Fills a bar to a share of its length.
export function fill(bar, share) {
  bar.style.transform = `translateX(${-100 * (1 - Math.min(Math.max(share, 0), 1))}%)`;
}

// Returns whether a reading has the position of one finger. The position is null without a
// calibration, and while the LED is off.
export function placed(touch) {
  return Boolean(touch?.touching) && touch.position_um !== null && !several(touch);
}

// Returns whether the board detects several fingers; a measured position then lies between them.
export function several(touch) {
  return touch?.fingers?.length > 1;
}

// Fills a <dl> with rows of <dt> and <dd> from pairs of name and value; omits pairs without a value.
export function list(root, pairs) {
  root.replaceChildren(...pairs
    .filter(([, value]) => value !== null && value !== undefined && value !== "")
    .map(([name, value]) => make("div", "", make("dt", "", name), make("dd", "", String(value)))));
}

// Adds a canvas with the resolution of the screen, and returns a function (draw, key) that draws it.
// `draw(context, width, height)` uses CSS pixels. Without a height, the style sheet sets the height.
// `key` stands for the content: with an unchanged key, the canvas is drawn again only after a change
// of its size or of the colours.
export function canvas(root, height) {
  const element = root.appendChild(make("canvas"));
  if (height) element.style.height = `${height}px`;
  const context = element.getContext("2d");
  let width = 0, last = () => {}, shown = null;
  const paint = () => {
    context.setTransform(devicePixelRatio, 0, 0, devicePixelRatio, 0, 0);
    context.clearRect(0, 0, width, height);
    if (width) last(context, width, height);
  };
  new ResizeObserver(() => {
    width = element.clientWidth;
    height = element.clientHeight;
    element.width = Math.round(width * devicePixelRatio);
    element.height = Math.round(height * devicePixelRatio);
    paint();
  }).observe(element);
  painted.push(paint);
  return (draw, key = {}) => {
    if (key === shown) return;
    shown = key;
    last = draw;
    paint();
  };
}

// Colours of the style sheet by name; read again when the colour scheme changes.
const names = ["text", "quiet", "edge", "faint", "place", "force"];
const painted = [];
export const colours = {};
function look() {
  const style = getComputedStyle(document.documentElement);
  for (const name of names) colours[name] = style.getPropertyValue(`--${name}`).trim();
  for (const paint of painted) paint();
}
matchMedia("(prefers-color-scheme: dark)").addEventListener("change", look);
look();

export const FULL_FORCE_MN = 10000;  // force at the end of all force scales
