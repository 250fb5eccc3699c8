// State of the present recording, with a button to start or stop it if this browser may record.
import { list } from "../dom.js";
import { request } from "../request.js";

export function recording(root) {
  const recorded = document.getElementById("recorded");
  let it = null, may = false, refused = "";

  root.addEventListener("click", async () => {
    root.disabled = true;
    ({ refused } = await request("recording", it.on ? "stop" : "start"));
    root.disabled = false;
    show();
  });

  // The key m marks the present moment, unless the person types a text.
  document.addEventListener("keydown", async (event) => {
    if (event.key !== "m" || event.repeat || event.ctrlKey || event.metaKey || event.altKey) return;
    if (!it?.on || !may || event.target.closest?.("input, textarea, select, [contenteditable]")) return;
    ({ refused } = await request("recording", "mark"));
    show();
  });

  function show() {
    root.hidden = !it || !may;
    if (!it) return;
    root.classList.toggle("on", it.on);
    root.textContent = it.on ? "stop" : "record";
    list(recorded, [
      ["recording", refused || it.error],
      [it.on ? "records" : "recorded", it.file],
      ["size", it.file && `${(it.bytes / 1e6).toFixed(2)} MB`],
      ["time", it.file && `${it.seconds.toFixed(1)} s`],
      ["lost", it.file && it.lost],
      ["marks (key m)", it.file && it.marks],
    ]);
  }

  return (state, news) => {
    if (!("recording" in news || "may_command" in news)) return;
    it = state.recording;
    may = state.may_command;
    show();
  };
}
