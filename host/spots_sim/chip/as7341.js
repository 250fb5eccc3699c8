// as7341.py for the live page, with its default quirks; tests/live compares both byte by byte. It has no flicker
// detector: FD_STATUS is 0.
//
// `light.collect(startUs, endUs, ledMA)` returns what the photodiodes collect in an interval, in counts
// at gain 1x by diode. All times are in us since power-on.

import { Converter, STEP_US } from "./converter.js";
import { Fifo } from "./fifo.js";

export const ADDRESS = 0x39;
const AUTO_ZERO_US = 15000, WAIT_US = 2780, LOW_POWER_US = 500, POWER_ON_US = 200, SMUX_US = 200;
const EXPOSURE = [0x81, 0xca, 0xcb];  // registers ATIME and ASTEP
// DS000504: samples outside the thresholds before an interrupt, by APERS; FIFO entries, by FIFO_TH.
const PERSISTENCE = [0, 1, 2, 3, 5, 10, 15, 20, 25, 30, 35, 40, 45, 50, 55, 60];
const FIFO_LEVELS = [1, 4, 8, 16];
// DS000504, CFG10: limits of the automatic gain in 1/8 of full scale, by the codes AGC_H and AGC_L.
const AGC_HIGH = [4, 5, 6, 7], AGC_LOW = [1, 2, 3, 4];
// Writes have no effect: identity, status, counts, and the FIFO's level and data.
const READ_ONLY = new Set([0x90, 0x91, 0x92, 0xdb, 0xfd, 0xfe, 0xff, ...Array.from({ length: 0x14 }, (_, i) => 0x94 + i)]);
const RESET_VALUES = {
  0x92: 0x24, 0xaa: 0x09, 0xac: 0x0c, 0xaf: 0x10, 0xb1: 0x88, 0xb3: 0xf2, 0xbe: 0x02, 0xca: 0xe7, 0xcb: 0x03, 0xcf: 0x99,
  0xd6: 0xff, 0xd7: 0x21,
};

export class AS7341 {
  #main; #bank1; #smuxRam; #pointer; #smuxDone; #start; #endUs; #partStart; #collected; #cycle; #live; #latched;
  #first; #outside; #fifo; #autoGain; #onSince; #light; #converter;
  #now = 0;

  constructor(light, noise, draw) {
    this.#light = light;
    this.#converter = new Converter(noise, draw);
    this.powerOn(0);
  }

  powerOn(nowUs) {
    this.#now = this.#onSince = Math.max(nowUs, this.#now);
    this.#main = new Uint8Array(256);
    for (const [register, value] of Object.entries(RESET_VALUES)) this.#main[register] = value;
    this.#bank1 = new Uint8Array(256);
    this.#bank1[0x74] = 0x04;
    this.#smuxRam = new Uint8Array(20);
    this.#converter.route(this.#smuxRam);
    this.#pointer = this.#cycle = this.#outside = this.#partStart = 0;
    this.#smuxDone = this.#start = this.#autoGain = null;  // no command, no integration, no automatic gain yet
    this.#first = false;
    this.#endUs = Infinity;  // end of the running integration
    this.#collected = {};  // counts at gain 1x by diode, up to `#partStart`
    this.#live = this.#latched = new Uint8Array(13);  // ASTATUS and the counts of the last sample
    this.#fifo = new Fifo();
  }

  // Transfers. The bus calls advance(now) first, so that time never decreases.

  answers() {
    return this.#now - this.#onSince >= POWER_ON_US;
  }

  // Handles a write transfer: the address of the first register, then the register values.
  write([pointer, ...values]) {
    if (pointer === undefined) return;
    this.#pointer = pointer;
    for (const value of values) {
      this.#set(this.#pointer, value);
      this.#pointer = (this.#pointer + 1) & 0xff;
    }
  }

  // Handles a read transfer into `data`. A sample that ends during a transfer is stored at once, so the
  // chip needs the duration of a byte.
  read(data, byteUs) {
    const beganUs = this.#now;
    for (let i = 0; i < data.length; i++) {
      const pointer = this.#pointer;
      if (i && pointer === 0xfe && !this.#fifo.entries.length) this.advance(beganUs + byteUs * i);
      data[i] = this.#get(pointer);
      // A transfer of any length reads the FIFO from its last two registers.
      this.#pointer = pointer === 0xff ? 0xfe : pointer + 1;
    }
  }

  advance(nowUs) {
    this.#now = Math.max(nowUs, this.#now);
    if (this.#smuxDone !== null && this.#now >= this.#smuxDone) {
      this.#smuxDone = null;
      this.#main[0x80] &= ~0x10;
      if ((this.#main[0xaf] >> 3 & 3) === 2) this.#converter.route(this.#smuxRam);
    }
    while (this.#now >= this.#endUs) this.#complete(this.#endUs);
  }

  // Registers.

  #bank1Selected() {
    return (this.#main[0xa9] & 0x10) !== 0;
  }

  #get(register) {
    if (register >= 0x80) {
      if (this.#bank1Selected() && register !== 0xa9) return 0;
      if (register === 0x94) return this.#latch();
      if (register >= 0x95 && register <= 0xa0) return this.#latched[register - 0x94];
      if (register === 0xdb) return 0;
      if (register === 0xfd) return this.#fifo.entries.length;
      if (register === 0xfe) return this.#fifo.low();
      if (register === 0xff) return this.#fifo.high();
      return this.#main[register];
    }
    if (register < 0x14) return this.#smuxRam[register];
    return register >= 0x60 && register <= 0x74 && this.#bank1Selected() ? this.#getBank1(register) : 0;
  }

  #getBank1(register) {
    if (register === 0x60) return this.#latch();
    if (register <= 0x62) return this.#latched[register - 0x60];
    if (register <= 0x65) return this.#steps() >> (8 * (register - 0x63)) & 0xff;
    if (register <= 0x6f) return this.#latched[3 + register - 0x66];
    return this.#bank1[register];
  }

  #latch() {
    this.#latched = this.#live;
    return this.#latched[0];
  }

  #set(register, value) {
    const main = this.#main;
    if (register < 0x14) this.#smuxRam[register] = value;
    else if (register >= 0x60 && register <= 0x74) {
      if (!this.#bank1Selected() || register < 0x70) return;
      const beforeMA = this.#ledMA();
      this.#bank1[register] = value;
      if (register === 0x70) this.#runOrStop();
      // Collect only if the light changes, so that noise does not depend on other writes.
      if (this.#ledMA() !== beforeMA) this.#collect(this.#now, beforeMA);
    } else if (register === 0xa9) main[register] = value;
    else if (register < 0x80 || this.#bank1Selected() || READ_ONLY.has(register)) return;
    else if (register === 0x93) main[register] &= ~value;
    else if (register === 0x80) this.#setEnable(value);
    else if (register === 0xfa) {
      if (value & 0x02) {
        this.#fifo = new Fifo();
        main[0xa7] &= ~0x80;
      }
      if (value & 0x01 && main[0xa7] & 0x02) {
        main[0xa7] &= ~0x02;
        this.#runOrStop();
      }
    } else {
      main[register] = value;
      if (register === 0xaa || register === 0xb1) this.#autoGain = null;
      if (EXPOSURE.includes(register) && this.#start !== null) this.#endUs = this.#end();
    }
  }

  #setEnable(value) {
    const before = this.#main[0x80];
    this.#main[0x80] = value;
    if ((value & 0x12) === 0x12) this.#main[0x80] &= ~0x10;  // refused while the chip samples
    else if (value & 0x10 && !(before & 0x10)) this.#smuxDone = this.#now + SMUX_US;
    this.#runOrStop();
  }

  #runOrStop() {
    // In the modes SYNS and SYND, a sample waits for an edge at the pin GPIO, which has none. After an
    // interrupt with the bit SAI, the chip sleeps until SAI_ACT is cleared.
    const running = (this.#main[0x80] & 0x03) === 0x03 && !(this.#bank1[0x70] & 0x03) && !(this.#main[0xa7] & 0x02);
    if (running && this.#start === null) {
      this.#first = true;
      this.#begin(this.#now + (this.#main[0xd6] ? AUTO_ZERO_US : 0));
      this.#main[0xa3] &= ~0x40;
    } else if (!running && this.#start !== null) {
      this.#collect(this.#now);
      this.#rest();
    }
  }

  // Integration.

  #steps() {
    return (this.#main[0x81] + 1) * ((this.#main[0xca] | this.#main[0xcb] << 8) + 1);
  }

  #fullScale() {
    return Math.min(65535, this.#steps());
  }

  #begin(startUs) {
    this.#start = this.#partStart = startUs;
    this.#endUs = this.#end();
    this.#collected = {};
  }

  #rest() {
    this.#start = null;
    this.#endUs = Infinity;
  }

  #end() {
    return this.#start + this.#steps() * STEP_US;
  }

  #ledMA() {
    return this.#bank1[0x70] & 0x08 && this.#bank1[0x74] & 0x80 ? 4 + 2 * (this.#bank1[0x74] & 0x7f) : 0;
  }

  #collect(untilUs, ledMA = this.#ledMA()) {
    if (this.#start === null || untilUs <= this.#partStart) return;
    const part = this.#light.collect(this.#partStart, untilUs, ledMA);
    for (const diode in part) this.#collected[diode] = (this.#collected[diode] ?? 0) + part[diode];
    this.#partStart = untilUs;
  }

  #complete(endUs) {
    const main = this.#main;
    this.#collect(endUs);
    const fullScale = this.#fullScale();
    const [counts, overloaded] = this.#converter.convert(this.#collected, this.#gain(), endUs - this.#start, fullScale);
    if (main[0x80] & 0x40) counts[5] = 0;  // the flicker detector uses the last ADC
    const saturation = (Math.max(...counts) >= fullScale ? 0x10 : 0) | (overloaded ? 0x08 : 0);
    const live = (saturation ? 0x80 : 0) | this.#gain(), bytes = counts.flatMap((count) => [count & 0xff, count >> 8]);
    this.#live = Uint8Array.of(live, ...bytes);
    this.#setGain(counts);
    main[0xa3] = 0x40 | saturation;
    if (saturation) main[0x93] |= 0x80;
    if (this.#first) this.#latched = this.#live;  // the counts for a driver that never reads ASTATUS
    this.#first = false;
    if (this.#persists(counts) && main[0xf9] & 0x08) main[0x93] |= 0x08;
    this.#push(live, counts);
    if (main[0xac] & 0x10 && main[0x93] & main[0xf9] & 0x08) main[0xa7] |= 0x02;
    this.#cycle += 1;
    const every = main[0xd6];
    let pauseUs = every > 0 && every < 255 && this.#cycle % every === 0 ? AUTO_ZERO_US : 0;
    if (main[0x80] & 0x08) pauseUs += (main[0x83] + 1) * WAIT_US * (main[0xa9] & 0x04 ? 16 : 1);
    if (main[0xa9] & 0x20) pauseUs += LOW_POWER_US;
    if (main[0xa7] & 0x02) this.#rest();
    else this.#begin(endUs + pauseUs);
  }

  // Returns the code of the gain in use: that of CFG1, or the automatic one.
  #gain() {
    return Math.min(this.#autoGain ?? this.#main[0xaa] & 0x1f, 10);
  }

  // Sets the automatic gain (SP_AGC) for the next sample by the counts of this one.
  #setGain(counts) {
    const main = this.#main;
    if (!(main[0xb1] & 0x04)) {
      this.#autoGain = null;
      return;
    }
    const eighths = 8 * counts[Math.min(main[0xb5] & 7, 5)] / this.#fullScale();
    const step = eighths > AGC_HIGH[main[0xb3] >> 6] ? -1 : eighths < AGC_LOW[main[0xb3] >> 4 & 3] ? 1 : 0;
    this.#autoGain = Math.max(0, Math.min(this.#gain() + step, main[0xcf] & 0x0f));
  }

  #persists(counts) {
    const main = this.#main, count = counts[Math.min(main[0xb5] & 7, 5)];
    const low = main[0x84] | main[0x85] << 8, high = main[0x86] | main[0x87] << 8;
    this.#outside = count >= low && count <= high ? 0 : this.#outside + 1;
    const least = PERSISTENCE[main[0xbd] & 15];
    return least === 0 || this.#outside >= least;
  }

  // Appends to the FIFO the values that FIFO_MAP selects from ASTATUS and the six counts. With the bit
  // FIFO_WRITE_FD, the FIFO is for the flicker detector.
  #push(live, counts) {
    const main = this.#main;
    if (main[0xd7] & 0x80) return;
    const entries = [live, ...counts].filter((_, i) => main[0xfc] & 1 << i).map((value) => [value & 0xff, value >> 8]);
    if (this.#fifo.push(entries)) main[0xa7] |= 0x80;
    if (main[0xf9] & 0x04 && this.#fifo.entries.length >= FIFO_LEVELS[main[0xb1] >> 6]) main[0x93] |= 0x04;
  }
}
