// What keeps the strip from being felt, and the next step; empty while all is well.

export function next(root) {
  return (state) => {
    const sentence = state.connection !== "live"
      ? "the server does not answer; next: start 'spots serve' again, and this page connects"
      : state.board?.next || state.untrusted || "";
    if (root.textContent !== sentence) root.textContent = sentence;
    root.hidden = !sentence;
  };
}
