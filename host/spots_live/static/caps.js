// Names of keys in the visitor's keyboard layout: what a board on USB types on this computer. Some browsers do not
// know it; the names then are American.

const CODES = [...[..."ABCDEFGHIJKLMNOPQRSTUVWXYZ"].map((one) => `Key${one}`), ...[..."1234567890"].map((one) => `Digit${one}`)];
const FIRST = 4;  // usage of KeyA; the others follow
const USAGES = {
  ...Object.fromEntries(CODES.map((code, i) => [code, FIRST + i])), Minus: 45, Equal: 46, BracketLeft: 47, BracketRight: 48, Backslash: 49,
  Semicolon: 51, Quote: 52, Backquote: 53, Comma: 54, Period: 55, Slash: 56, IntlBackslash: 100,
};

// Returns the names by page and usage, a letter as capital.
export async function caps() {
  const map = await navigator.keyboard?.getLayoutMap().catch(() => null) ?? [];
  const known = [...map].filter(([code]) => code in USAGES);
  return Object.fromEntries(known.map(([code, one]) => [`7/${USAGES[code]}`, code.startsWith("Key") ? one.toUpperCase() : one]));
}
