// The page: fingers press the drawn strip, controls change the strip's world, and keys of the board type.
import { ask, ready } from "./link.js";
import { press } from "./press.js";
import { typing } from "./typing.js";

const { layouts, strips } = await ready;
const $ = (id) => document.getElementById(id), note = $("live-note");

function fill(select, options) {
  select.append(...Object.entries(options).map(([value, words]) => new Option(words, value)));
}
fill($("choose-strip"), strips);
fill($("choose-layout"), layouts);

// Sends a request; while it runs, its control is disabled. A refusal is shown beside the controls.
async function tell(control, path, body) {
  control.disabled = true;
  note.textContent = (await ask(path, body)).refused ?? "";
  control.disabled = false;
}
$("choose-strip").addEventListener("change", ({ target }) => tell(target, "strip", target.value));
$("choose-layout").addEventListener("change", ({ target }) => tell(target, "layout", target.value));

const DUST_SHARE = 0.01;  // contact of one grain, as a share of full contact
const LAMP_UW = 1;  // of one step of the slider
let dust = [];
const length_mm = () => $("strip").dataset.lengthMm ?? 85;
function world() {
  const drift = $("drift").valueAsNumber / 100, lampUW = LAMP_UW * $("lamp").valueAsNumber;
  $("drift-shown").textContent = `${$("drift").value} %`;
  $("lamp-shown").textContent = `${lampUW} µW/cm²`;
  $("dust-shown").textContent = dust.length ? `at ${dust.map(({ xMm }) => xMm.toFixed(0)).join(", ")} mm` : "none";
  ask("world", { drift, lampUW, dust });
}
for (const id of ["drift", "lamp"]) $(id).addEventListener("input", world);
$("add-dust").addEventListener("click", () => {
  dust = [...dust, { xMm: Math.random() * length_mm(), share: DUST_SHARE }];
  world();
});
$("wipe").addEventListener("click", () => { dust = []; world(); });

press($("strip"), length_mm);
typing($("typed"));
world();
await tell($("choose-strip"), "strip", $("choose-strip").value);
