// bus.py for the live page: acknowledgement and duration of transfers.
import { ADDRESS } from "./as7341.js";

export const ENODEV = 19;

// `clock.timeUs` is advanced by each transfer.
export class I2CBus {
  constructor(chip, clock, frequencyHz = 400_000) {
    Object.assign(this, { chip, clock, frequencyHz });
  }

  // START, address, data, STOP. Returns 0, or ENODEV if no chip acknowledges the address.
  write(address, data) {
    if (!this.#answers(address)) return ENODEV;
    this.#spend(2, 1 + data.length);
    this.chip.advance(this.clock.timeUs);
    this.chip.write(data);
    return 0;
  }

  // Writes the number of a register, then reads into `data` after a repeated START. Returns as `write`.
  writeRead(address, register, data) {
    if (!this.#answers(address)) return ENODEV;
    const bits = 3, count = 3 + data.length;
    // The chip is read when its first byte is sent, before the transfer ends.
    this.chip.advance(this.clock.timeUs + this.#bitsUs(bits + 9 * 3));
    this.chip.write([register]);
    this.chip.read(data, this.#bitsUs(9));
    this.#spend(bits, count);
    return 0;
  }

  #answers(address) {
    this.chip.advance(this.clock.timeUs);
    const found = address === ADDRESS && this.chip.answers();
    if (!found) this.#spend(2, 1);
    return found;
  }

  #bitsUs(bits) {
    return bits * 1e6 / this.frequencyHz;
  }

  #spend(bits, count) {
    this.clock.timeUs += this.#bitsUs(bits + 9 * count);
  }
}
