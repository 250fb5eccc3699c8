// Why the strip cannot be read, and the next step; empty if there is no problem.

export function next(root) {
  return (state) => {
    const sentence = state.connection !== "live"
      ? "the server does not answer; next: start 'spots serve' again, and this window reconnects"
      : state.board?.next || state.untrusted || "";
    if (root.textContent !== sentence) root.textContent = sentence;
    root.hidden = !sentence;
  };
}
