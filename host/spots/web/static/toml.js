// Texts of TOML files: comments, and values that are changed in place. The server checks each result.

// Returns the comments at the beginning of a text, and the number of all other comments.
export function comments(text) {
  const head = /^(?:[ \t]*(?:#.*)?\r?\n)*/.exec(text)[0];
  return { head, others: count(text.slice(head.length)) };
}

// Returns the number of comments in a text: the number of # outside of strings.
export function count(text) {
  return (text.replace(/"""(?:[^\\]|\\[^])*?"""|'''[^]*?'''|"(?:[^"\\\n]|\\.)*"|'[^'\n]*'/g, '""').match(/#/g) ?? []).length;
}

// Strings and numbers have the same syntax in JSON and TOML.
export const value = JSON.stringify;

const isTable = (it) => it !== null && typeof it === "object" && !Array.isArray(it);
const isList = (it) => Array.isArray(it) && it.every(isTable);
const equal = (a, b) => canonical(a) === canonical(b);

// Returns a text that is equal for equal contents, whatever the order of their keys.
export function canonical(it) {
  return JSON.stringify(it, (_, part) => (isTable(part) ? Object.fromEntries(Object.entries(part).sort(([a], [b]) => (a < b ? -1 : 1))) : part));
}

// Returns the text of a file for a content of numbers, strings, tables and lists of tables.
export function written(content, prefix = "") {
  const plain = Object.entries(content).filter(([, it]) => !isTable(it) && !isList(it));
  const tables = Object.entries(content).filter(([, it]) => isTable(it) || isList(it));
  return [
    ...plain.map(([key, it]) => `${key} = ${value(it)}\n`),
    ...tables.flatMap(([key, it]) => (isTable(it) ? [[`[${prefix}${key}]`, it]] : it.map((one) => [`[[${prefix}${key}]]`, one]))
      .map(([head, one]) => `\n${head}\n${written(one, `${prefix}${key}.`)}`)),
  ].join("");
}

// Returns the text of a file after its content changed from `was` to `now`. Lines whose values did not
// change keep their text.
export function patched(text, was, now) {
  const blocks = [{ name: "", lines: [] }];
  for (const line of text.split("\n")) {
    const [, name] = /^\s*\[\[?\s*([^\]]*?)\s*\]\]?\s*(?:#.*)?$/.exec(line) ?? [];
    if (name !== undefined) blocks.push({ name, lines: [] });
    blocks.at(-1).lines.push(line);
  }
  patch(blocks, blocks[0], "", was, now);
  return blocks.map(({ lines }) => lines.join("\n")).join("\n");
}

function patch(blocks, block, prefix, was, now) {
  for (const key of new Set([...Object.keys(was), ...Object.keys(now)])) {
    const [before, after] = [was[key], now[key]], name = `${prefix}${key}`;
    if (equal(before, after)) continue;
    if (isTable(before) || isTable(after)) {
      const there = blocks.find((one) => one.name === name);
      if (!after) drop(blocks, blocks.filter((one) => one.name === name || one.name.startsWith(`${name}.`)));
      else if (before && there) patch(blocks, there, `${name}.`, before, after);
      else add(blocks, block.name ? blocks.indexOf(block) + 1 : blocks.length, name, `[${name}]`, after);
    } else if (isList(before ?? after)) patchList(blocks, name, before ?? [], after ?? []);
    else set(block.lines, key, after);
  }
}

// Tables that are equal in both lists stay; tables between them are changed, removed or added.
function patchList(blocks, name, was, now) {
  const there = blocks.filter((one) => one.name === name), pairs = [];
  let last = -1;
  now.forEach((one, j) => {
    const i = was.findIndex((other, k) => k > last && equal(other, one));
    if (i >= 0) pairs.push([last = i, j]);
  });
  let [i0, j0] = [0, 0], at = there[0] ? blocks.indexOf(there[0]) : blocks.length;
  for (const [i1, j1] of [...pairs, [was.length, now.length]]) {
    const both = Math.min(i1 - i0, j1 - j0);
    for (let k = 0; k < both; k++) if (there[i0 + k]) patch(blocks, there[i0 + k], `${name}.`, was[i0 + k], now[j0 + k]);
    if (there[i0 + both - 1]) at = blocks.indexOf(there[i0 + both - 1]) + 1;
    drop(blocks, there.slice(i0 + both, i1));
    for (const one of now.slice(j0 + both, j1)) add(blocks, at++, name, `[[${name}]]`, one);
    if (there[i1]) at = blocks.indexOf(there[i1]) + 1;
    [i0, j0] = [i1 + 1, j1 + 1];
  }
}

function drop(blocks, which) {
  for (const one of which) blocks.splice(blocks.indexOf(one), 1);
}

function add(blocks, at, name, head, content) {
  const { lines } = blocks[at - 1];
  if (lines.at(-1)?.trim()) lines.push("");
  blocks.splice(at, 0, { name, lines: [head, ...written(content, `${name}.`).split("\n")] });
}

function set(lines, key, to) {
  const at = lines.findIndex((line) => new RegExp(`^\\s*${key}\\s*=`).test(line));
  if (to === undefined) { if (at >= 0) lines.splice(at, 1); return; }
  if (at < 0) {
    const last = lines.findLastIndex((line) => /^\s*[^#\s]/.test(line));
    lines.splice(last + 1, 0, `${key} = ${value(to)}`);
    return;
  }
  lines[at] = lines[at].replace(/(=\s*)("(?:[^"\\]|\\.)*"|'[^']*'|[^\s#]+)(\s*)/, (_, equals, old, gap) => {
    const text = value(to);
    return equals + text + (gap && " ".repeat(Math.max(gap.length + old.length - text.length, 1)));
  });
}
