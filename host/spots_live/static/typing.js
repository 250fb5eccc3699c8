// The computer of the simulated board: its USB keyboard types into a text field of this page.
const SHIFTS = 0x22, SHIFT = 0x02, ENTER = 0x28, BACKSPACE = 0x2a;

export async function typing(field) {
  const { characters } = await fetch("words.json").then((answer) => answer.json());
  let before = [];
  document.addEventListener("report", ({ detail: { name, report } }) => {
    if (name !== "keyboard") return;
    const [modifiers, , ...usages] = report;
    for (const usage of usages) if (usage && !before.includes(usage)) type(modifiers & SHIFTS ? SHIFT : 0, usage, modifiers & ~SHIFTS);
    before = usages;
  });

  function type(shift, usage, others) {
    if (others) return;  // a shortcut, which types nothing
    if (usage === BACKSPACE) field.value = field.value.slice(0, -1);
    else field.value += usage === ENTER ? "\n" : characters[`${shift}/${usage}`] ?? "";
    field.scrollTop = field.scrollHeight;
  }
}
