// converter.py for the live page: the same light and the same random numbers give the same counts.

export const STEP_US = 2.78;  // unit of the integration time

// AN000666, table of pixels: each photodiode consists of one or two pixels.
const PIXELS_OF = {
  F1: [2, 32], F2: [10, 25], F3: [1, 31], F4: [11, 26], F5: [13, 19], F6: [8, 29], F7: [14, 20], F8: [7, 28],
  CLEAR: [17, 35], NIR: [38], DARK: [37], FLICKER: [39],
};
// DS000504, figure "gain": factors relative to 64x.
const GAIN = [0.008, 0.016, 0.032, 0.065, 0.125, 0.25, 0.5, 1.0, 2.0, 3.95, 7.75].map((factor) => 64 * factor);

export class Converter {
  // `noise`: read_counts, electrons_per_count_1x, dark_counts_512x and ratio_ppm, as `ChipNoise` in
  // Python. `draw()` returns a normally distributed random number.
  constructor(noise, draw) {
    this.noise = noise;
    this.draw = draw;
    this.route(new Uint8Array(20));
  }

  // Connects the diodes as the SMUX does: for each pixel, a half byte with its ADC.
  route(smuxRam) {
    this.routing = Array.from({ length: 6 }, () => new Map());
    for (const [diode, pixels] of Object.entries(PIXELS_OF)) {
      for (const pixel of pixels) {
        const adc = smuxRam[pixel >> 1] >> (4 * (pixel & 1)) & 15;
        if (adc < 1 || adc > 6) continue;
        const routed = this.routing[adc - 1];
        routed.set(diode, (routed.get(diode) ?? 0) + 1 / pixels.length);
      }
    }
  }

  // Returns the six counts of a sample, and whether the front end of an ADC saturated. `collected` is
  // the light of each diode, in counts at gain 1x.
  convert(collected, gainCode, durationUs, fullScale) {
    const { noise } = this, gain = GAIN[gainCode];
    const dark = noise.dark_counts_512x * gain / GAIN[10] * durationUs / 98000;
    const electrons = noise.electrons_per_count_1x / gain, ratio = 1e-6 * noise.ratio_ppm;
    const read = noise.read_counts * noise.read_counts;
    let most = -Infinity;
    const counts = this.routing.map((routed) => {
      let total = 0;
      for (const [diode, share] of routed) total += share * (collected[diode] ?? 0);
      const light = total * gain + dark;
      most = Math.max(most, light);
      const shot = light > 0 ? light / electrons : 0;
      const sigma = Math.sqrt(read + (shot + (ratio * light) * (ratio * light)));
      return Math.min(Math.max(Math.floor(light + sigma * this.draw() + 0.5), 0), fullScale);
    });
    // An ADC makes at most one count in each step. With far more light, its front end saturates.
    return [counts, most > 1.5 * durationUs / STEP_US];
  }
}
