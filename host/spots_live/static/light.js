// The light that the simulated chip receives from the strip: presses, dust, drift and lamps. The tables
// are from the simulator's optics, see spots_live/strips.py.
import { heldMN } from "./hand.js";

const STEP_US = 2500;  // longest time step within one integration; a finger counts as still during it

export class Light {
  drift = 0;  // share of the drift that the tables describe, 0 to 1
  lampUW = 0;  // steady light of a lamp, in uW/cm2, in addition to that of the strip's surroundings
  dust = [];  // places in mm where dust couples light
  fingers = new Map();  // by id, see hand.js

  constructor(tables, draw) {
    this.tables = tables;
    this.draw = draw;
  }

  // Returns what each diode collects in an interval, in counts at gain 1x, by diode.
  collect(startUs, endUs, ledMA) {
    const { tables } = this, { diodes, led } = tables, durationUs = endUs - startUs;
    const rates = diodes.map(() => 0);
    if (ledMA > 0) {
      const steps = Math.ceil(durationUs / STEP_US);
      for (let i = 0; i < steps; i++) this.#add(rates, startUs + (i + 0.5) * durationUs / steps, 1 / steps);
      const level = 1 + 1e-6 * led.noise_ppm_10ms * Math.sqrt(10_000 / durationUs) * this.draw();
      const source = led.uW_cm2_per_mA * ledMA / (1 + ledMA / led.bend_mA);
      rates.forEach((_, i) => { rates[i] = (rates[i] + tables.dust[i]) * source * level; });
    }
    const ambient = this.lampUW + this.#surroundings(startUs * 1e-6, endUs * 1e-6);
    return Object.fromEntries(diodes.map((diode, i) => [diode, (rates[i] + ambient * tables.ambient[i]) * durationUs / 1000]));
  }

  #add(rates, timeUs, weight) {
    for (const finger of this.fingers.values()) {
      const share = this.#share(heldMN(finger, timeUs));
      if (share > 0) this.#press(rates, finger.xMm, share, weight * share);
    }
    for (const { xMm, share } of this.dust) this.#press(rates, xMm, share, weight * share);
  }

  // Contact area at a force, as a share of full contact, see spots_sim/strip/contact.py.
  #share(forceMN) {
    const { threshold_mN, half_mN, early_share, early_mN } = this.tables.contact, over = forceMN - threshold_mN;
    if (forceMN <= 0) return 0;
    if (over <= 0) return early_share * Math.exp(over / early_mN);
    return early_share + (1 - early_share) * (over / half_mN) / (1 + over / half_mN);
  }

  #press(rates, xMm, share, weight) {
    const { logs, drift, step_mm } = this.tables, at = xMm / step_mm;
    const place = Math.min(Math.max(Math.floor(at), 0), logs[0].length - 2), part = at - place;
    // With one table the colour does not depend on the contact share.
    const level = share * (logs.length - 1), lower = Math.min(Math.floor(level), Math.max(logs.length - 2, 0));
    const upper = Math.min(lower + 1, logs.length - 1), mix = level - lower;
    for (let i = 0; i < rates.length; i++) {
      const log = (k, p) => logs[k][p][i] + this.drift * drift[k][p][i];
      const along = (k) => (1 - part) * log(k, place) + part * log(k, place + 1);
      rates[i] += weight * Math.exp((1 - mix) * along(lower) + mix * along(upper));
    }
  }

  #surroundings(startS, endS) {
    const { uW_cm2, flicker_percent, flicker_hz } = this.tables.lamp;
    if (!uW_cm2 || !flicker_percent) return uW_cm2;
    const omega = 2 * Math.PI * flicker_hz;
    const swing = (Math.sin(omega * endS) - Math.sin(omega * startS)) / (omega * (endS - startS));
    return uW_cm2 * (1 + flicker_percent / 100 * swing);
  }
}
