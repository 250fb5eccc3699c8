// Decodes streams with the decoder of the page `live`, for test_decoder.py. Each line of standard input
// is a JSON list of pieces in hexadecimal; each line of standard output has the frames and the statistics.

import readline from "node:readline";
import { Decoder } from "../../host/spots_live/static/decoder.js";

for await (const line of readline.createInterface({ input: process.stdin })) {
  const decoder = new Decoder();
  const frames = JSON.parse(line).flatMap((piece) => decoder.feed(Buffer.from(piece, "hex")));
  console.log(JSON.stringify([frames, decoder.stats]));
}
