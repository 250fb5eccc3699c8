"""The six ADCs of a simulated AS7341: the diodes that each counts, the gain, noise, saturation."""

from __future__ import annotations

import math
from dataclasses import dataclass

STEP_US = 2.78  # unit of the integration time

# AN000666, table of pixels: each photodiode consists of one or two pixels.
PIXELS_OF = {
    "F1": (2, 32), "F2": (10, 25), "F3": (1, 31), "F4": (11, 26), "F5": (13, 19), "F6": (8, 29),
    "F7": (14, 20), "F8": (7, 28), "CLEAR": (17, 35), "NIR": (38,), "DARK": (37,), "FLICKER": (39,),
}  # fmt: skip
DIODES = tuple(PIXELS_OF)

# DS000504, figure "gain": factors relative to 64x. The steps are not exact powers of two.
GAIN = tuple(64 * g for g in (0.008, 0.016, 0.032, 0.065, 0.125, 0.25, 0.5, 1.0, 2.0, 3.95, 7.75))


@dataclass(frozen=True)
class ChipNoise:
    """Noise of the converter, in counts of the six ADCs; `read_counts` is added before rounding.

    The shot noise follows from the photo-electrons in one count at gain 1x. The dark counts are
    those at gain 512x in 98 ms. `ratio_ppm` is the standard deviation of each channel's gain
    between samples.
    """

    read_counts: float
    electrons_per_count_1x: float
    dark_counts_512x: float
    ratio_ppm: float = 0.0


class Converter:
    """Converts the light of a sample to six counts; no diode is connected at first."""

    def __init__(self, noise: ChipNoise, rng):
        self._noise = noise
        self._rng = rng
        # For each ADC: share of each diode in its counts.
        self.routing: list[dict[str, float]] = [{} for _ in range(6)]

    def route(self, smux_ram: bytes) -> None:
        """Connect the diodes as the SMUX does: for each pixel, a half byte with its ADC."""
        self.routing = [{} for _ in range(6)]
        for diode, pixels in PIXELS_OF.items():
            for pixel in pixels:
                adc = smux_ram[pixel >> 1] >> (4 * (pixel & 1)) & 0xF
                if 1 <= adc <= 6:
                    routed = self.routing[adc - 1]
                    routed[diode] = routed.get(diode, 0.0) + 1 / len(pixels)

    def convert(
        self, collected: dict[str, float], gain_code: int, duration_us: float, full_scale: int
    ) -> tuple[list[int], bool]:
        """Return the six counts of a sample, and whether the front end of an ADC saturated.

        `collected` is the light of each diode, in counts at gain 1x; a count ends at `full_scale`.
        """
        noise = self._noise
        gain = GAIN[gain_code]
        dark = noise.dark_counts_512x * gain / GAIN[10] * duration_us / 98_000.0
        electrons = noise.electrons_per_count_1x / gain
        ratio = 1e-6 * noise.ratio_ppm
        read = noise.read_counts**2
        counts = []
        most = -math.inf
        # For six numbers, plain Python is faster than NumPy.
        for routed, draw in zip(self.routing, self._rng.standard_normal(6).tolist()):
            total = 0.0
            for diode, share in routed.items():
                total += share * collected.get(diode, 0.0)
            light = total * gain + dark
            if light > most:
                most = light
            shot = light / electrons if light > 0 else 0.0
            sigma = math.sqrt(read + (shot + (ratio * light) ** 2))
            count = math.floor(light + sigma * draw + 0.5)
            counts.append(0 if count < 0 else full_scale if count > full_scale else count)
        # An ADC makes at most one count in each step. With far more light, its front end saturates.
        return counts, most > 1.5 * duration_us / STEP_US
