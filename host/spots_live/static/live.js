// The page: fingers press the drawn strip, controls change the strip's world, and a board on USB or a recording
// can take the place of the board of this tab.
import { caps } from "./caps.js";
import { ask, onPart, ready } from "./link.js";
import { press } from "./press.js";
import { typing } from "./typing.js";

const { layouts, strips } = await ready;
const $ = (id) => document.getElementById(id);
const WHAT = {
  tab: "Real: the firmware of a board, its protocol, keyboard and gamepad. Simulated: the sensor chip, the light, and your finger.",
  usb: "All of it is real: this page reads the board on USB.",
  file: "This is a recording of a board.",
};
const USB = "spots-live-usb";  // in the storage: this page read a board on USB before it was loaded again
const DUST_SHARE = 0.01;  // contact of one grain, as a share of full contact
const LENGTH_MM = 85;  // until the board has a calibration

// Sends a request; while it runs, its control is disabled. A refusal is shown below the controls.
async function tell(control, path, body) {
  control.disabled = true;
  const answer = await ask(path, body);
  control.disabled = false;
  $("live-note").textContent = answer.refused ?? "";
  return answer;
}

function fill(select, options) {
  select.append(...Object.entries(options).map(([value, words]) => new Option(words, value)));
}
fill($("choose-strip"), strips);
fill($("choose-layout"), layouts);

// Shows the controls of a source: `tab`, `usb` or `file`.
function use(source) {
  $("what").textContent = WHAT[source];
  for (const id of ["choose-strip", "world-of-tab"]) $(id).closest("label, div").hidden = source !== "tab";
  $("choose-layout").closest("label").hidden = source === "file";
  $("settings").hidden = source !== "usb";
  $("connect").textContent = source === "tab" ? "connect a board on USB" : "back to the simulated board";
  $("typed").placeholder = source === "usb" ? "click here: the board's keyboard types into this page" : "";
  document.body.dataset.source = source;
  try { sessionStorage.setItem(USB, source === "usb" ? "1" : ""); } catch { /* not stored: after a reload, connect again */ }
}

// The board of this tab.

let dust = [], length_mm = LENGTH_MM;
function world() {
  const drift = $("drift").valueAsNumber / 100, lampUW = $("lamp").valueAsNumber;
  $("drift-shown").textContent = `${$("drift").value} %`;
  $("lamp-shown").textContent = `${lampUW} µW/cm²`;
  $("dust-shown").textContent = dust.length ? `at ${dust.map(({ xMm }) => xMm.toFixed(0)).join(", ")} mm` : "none";
  ask("world", { drift, lampUW, dust });
}
for (const id of ["drift", "lamp"]) $(id).addEventListener("input", world);
$("add-dust").addEventListener("click", () => {
  dust = [...dust, { xMm: Math.random() * length_mm, share: DUST_SHARE }];
  world();
});
$("wipe").addEventListener("click", () => { dust = []; world(); });

async function simulate() {
  use("tab");
  await tell($("choose-strip"), "strip", $("choose-strip").value);
  world();
}
$("choose-strip").addEventListener("change", simulate);
$("choose-layout").addEventListener("change", ({ target }) => tell(target, "layout", target.value));

// A board on USB.

async function connect() {
  if (document.body.dataset.source !== "tab") return simulate();
  if (!navigator.serial) {
    $("live-note").textContent = "this browser has no Web Serial; next: open this page in Chrome, Edge, or Firefox 151 or later";
    return;
  }
  try {
    if (!(await navigator.serial.getPorts()).length) await navigator.serial.requestPort();
  } catch {
    return;  // the user has chosen no port
  }
  use("usb");
  await tell($("connect"), "usb", await caps());
}
$("connect").addEventListener("click", connect);

onPart("board", (board) => {
  length_mm = board.length_um ? board.length_um / 1000 : LENGTH_MM;
  if (document.body.dataset.source !== "usb" || board.exposure_us === undefined) return;
  $("exposure").value = board.exposure_us / 1000;
  $("average").value = board.average;
  $("keys-on").checked = board.keys === 1;
  $("gamepad-on").checked = board.gamepad === 1;
});
const set = (control, assignment) => tell(control, "command", `set ${assignment}`);
$("exposure").addEventListener("change", ({ target }) => set(target, `exposure_us=${Math.round(1000 * target.valueAsNumber)}`));
$("average").addEventListener("change", ({ target }) => set(target, `average=${target.value}`));
$("keys-on").addEventListener("change", ({ target }) => set(target, `keys=${target.checked ? 1 : 0}`));
$("gamepad-on").addEventListener("change", ({ target }) => set(target, `gamepad=${target.checked ? 1 : 0}`));
$("store").addEventListener("click", ({ target }) => tell(target, "command", "save"));

// Calls `take` with the file that the user chooses after a click on a button.
function chooses(button, chooser, take) {
  button.addEventListener("click", () => chooser.click());
  chooser.addEventListener("change", async () => {
    const [file] = chooser.files;
    if (file) await take(file);
    chooser.value = "";
  });
}

const FILE_MAX = 1 << 20;
chooses($("upload"), $("calibration-file"), async (file) => {
  // A calibration file is TOML. Its lines are a list of plain texts, which the board validates.
  const text = file.size < FILE_MAX ? await file.text() : "", list = /^lines = \[\n?([^\]]*)\]/m.exec(text)?.[1];
  const lines = [...(list ?? "").matchAll(/"([^"\n]*)"/g)].map(([, line]) => line);
  if (lines.length) await tell($("upload"), "calibration", lines);
  else $("live-note").textContent = `${file.name} is no calibration; next: choose a file that 'spots calibrate' has written`;
});

// Recordings.

// The worker sends the file of a recording at its end.
document.addEventListener("file", ({ detail: { file, name } }) => {
  const link = Object.assign(document.createElement("a"), { href: URL.createObjectURL(file), download: name });
  link.click();
  setTimeout(() => URL.revokeObjectURL(link.href), 10_000);
});
chooses($("play"), $("recording-file"), async (file) => {
  const { refused } = await tell($("play"), "play", file);
  if (!refused) use("file");
});

press($("strip"), () => length_mm);
typing($("typed"));
let again = "";
try { again = sessionStorage.getItem(USB) ?? ""; } catch { /* nothing is stored */ }
if (again && (await navigator.serial?.getPorts())?.length) {
  document.body.dataset.source = "tab";
  await connect();
} else {
  await simulate();
}
