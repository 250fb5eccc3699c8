// Runs sequences of accesses on the chip of the page `live`, for test_chip.py. Each line of standard
// input is a JSON list of steps; each line of standard output is the list of the answers.

import readline from "node:readline";
import { AS7341 } from "../../host/spots_sim/chip/as7341.js";
import { I2CBus } from "../../host/spots_sim/chip/bus.js";

function run({ noise, draws, steps }) {
  let drawn = 0, rates = {};
  const collect = (startUs, endUs, ledMA) =>
    Object.fromEntries(Object.entries(rates).map(([diode, rate]) => [diode, rate * (1 + ledMA) * (endUs - startUs) / 1000]));
  const clock = { timeUs: 0 }, chip = new AS7341({ collect }, noise, () => draws[drawn++ % draws.length]), bus = new I2CBus(chip, clock);
  const does = {
    wait: (us) => { clock.timeUs += us; },
    light: (given) => { chip.advance(clock.timeUs); rates = given; },
    power: () => chip.powerOn(clock.timeUs),
    write: (address, data) => bus.write(address, data),
    read: (address, register, size) => {
      const data = new Uint8Array(size), refused = bus.writeRead(address, register, data);
      return refused || [...data];
    },
  };
  return steps.map(([name, ...given]) => [does[name](...given) ?? null, clock.timeUs]);
}

for await (const line of readline.createInterface({ input: process.stdin })) console.log(JSON.stringify(run(JSON.parse(line))));
