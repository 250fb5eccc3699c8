// Imports modules in MicroPython for WebAssembly, each in an instance of its own.
//
//     node run.mjs HEAP_BYTES
//
// Each line of standard input is a request: a JSON list with the module, and with the folders that
// are copied into the memory of the instance. Each line of standard output is an answer: a JSON list
// with the lines that the module prints, and with the traceback if it raises, otherwise null.

import fs from "node:fs";
import path from "node:path";
import readline from "node:readline";
import { loadMicroPython } from "@micropython/micropython-webassembly-pyscript/micropython.mjs";

const [heapBytes] = process.argv.slice(2);

function copy(FS, from, to) {
  for (const entry of fs.readdirSync(from, { withFileTypes: true })) {
    const [source, target] = [path.join(from, entry.name), path.posix.join(to, entry.name)];
    if (entry.isDirectory()) {
      FS.mkdir(target);
      copy(FS, source, target);
    } else {
      FS.writeFile(target, fs.readFileSync(source));
    }
  }
}

async function run(module, folders) {
  const [printed, complained] = [[], []];
  const micropython = await loadMicroPython({
    heapsize: Number(heapBytes),
    stdout: (line) => printed.push(line),
    stderr: (line) => complained.push(line),
  });
  for (const folder of folders) {
    copy(micropython.FS, folder, micropython.FS.cwd());
  }
  try {
    micropython.pyimport(module);
    return [printed, null];
  } catch (error) {
    // The type on its own, for a locked heap leaves the traceback no room for it.
    complained.push(error.message, error.type ?? error.name);
    return [printed, complained.join("\n")];
  }
}

for await (const line of readline.createInterface({ input: process.stdin })) {
  const [module, ...folders] = JSON.parse(line);
  console.log(JSON.stringify(await run(module, folders)));
}
