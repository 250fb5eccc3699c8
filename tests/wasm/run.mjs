// Imports a module in MicroPython for WebAssembly, from folders that are copied into its memory.
//
//     node run.mjs MODULE HEAP_BYTES FOLDER...
//
// Prints what the module prints; ends with code 1 and the traceback if it raises.

import fs from "node:fs";
import path from "node:path";
import { loadMicroPython } from "@micropython/micropython-webassembly-pyscript/micropython.mjs";

const [module, heapBytes, ...folders] = process.argv.slice(2);
const micropython = await loadMicroPython({
  heapsize: Number(heapBytes),
  stdout: (line) => console.log(line),
  stderr: (line) => console.error(line),
});

function copy(from, to) {
  for (const entry of fs.readdirSync(from, { withFileTypes: true })) {
    const [source, target] = [path.join(from, entry.name), path.posix.join(to, entry.name)];
    if (entry.isDirectory()) {
      micropython.FS.mkdir(target);
      copy(source, target);
    } else {
      micropython.FS.writeFile(target, fs.readFileSync(source));
    }
  }
}

for (const folder of folders) {
  copy(folder, micropython.FS.cwd());
}
try {
  micropython.pyimport(module);
} catch (error) {
  // The type on its own, for a locked heap leaves the traceback no room for it.
  console.error(`${error.message}\n${error.type ?? error.name}`);
  process.exitCode = 1;
}
