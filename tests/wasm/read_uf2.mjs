// Prints the blocks of a UF2 file as JSON: [family, number, total, address, payload in base64].
//
//     node read_uf2.mjs FILE

import fs from "node:fs";
import uf2 from "uf2";

const data = fs.readFileSync(process.argv[2]);
const blocks = [];
for (let at = 0; at < data.length; at += 512) {
  const block = uf2.decodeBlock(new Uint8Array(data.subarray(at, at + 512)));
  const payload = Buffer.from(block.payload).toString("base64");
  blocks.push([block.boardFamily, block.blockNumber, block.totalBlocks, block.flashAddress, payload]);
}
console.log(JSON.stringify(blocks));
