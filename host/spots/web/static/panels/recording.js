// What is recorded, and the button for who may.
import { list } from "../dom.js";

export function recording(root) {
  const recorded = document.getElementById("recorded");
  let told = null, may = false, refused = "";

  root.addEventListener("click", async () => {
    root.disabled = true;
    try {
      const answer = await fetch("recording", { method: "POST", body: told.on ? "stop" : "start" });
      refused = answer.ok ? "" : await answer.text();
    } catch {
      refused = "the server does not answer";
    }
    root.disabled = false;
    show();
  });

  function show() {
    root.hidden = !told || !may;
    if (!told) return;
    root.classList.toggle("on", told.on);
    root.textContent = told.on ? "stop" : "record";
    list(recorded, [
      ["recording", refused],
      [told.on ? "records" : "recorded", told.file],
      ["size", told.file && `${(told.bytes / 1e6).toFixed(2)} MB`],
      ["time", told.file && `${told.seconds.toFixed(1)} s`],
      ["lost", told.file && told.lost],
    ]);
  }

  return (state, news) => {
    if (!("recording" in news || "may_record" in news)) return;
    told = state.recording;
    may = state.may_record;
    show();
  };
}
