"""When people press and release keys: percentiles of ten people, and of people at four speeds.

Source: AlvinKuruvilla/keystroke-data on GitHub, folder Facebook: free text on usual keyboards.
``docs/make/typing_times.py`` computes the percentiles from it. A finger that presses a soft strip
may be slower than a finger that presses a key.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

PERCENT = 0.2, 1, 5, 25, 50, 75, 95, 99, 99.8  # the tables have the values at these percentages


@dataclass(frozen=True)
class Times:
    """Percentiles of a person's times, at the percentages `PERCENT`.

    The interval is from the start of a touch to the start of the next one. Both times are drawn
    independently: in the data, their correlation is below 0.2, and as many touches overlap as with
    independent times.
    """

    held_ms: tuple[float, ...]
    interval_ms: tuple[float, ...]

    def held_s(self, rng: np.random.Generator) -> float:
        """Return a random duration of a touch, in seconds."""
        return _drawn(rng, self.held_ms)

    def interval_s(self, rng: np.random.Generator) -> float:
        """Return a random time between the starts of two touches, in seconds."""
        return _drawn(rng, self.interval_ms)


def _drawn(rng: np.random.Generator, percentiles_ms: tuple[float, ...]) -> float:
    return float(np.interp(rng.uniform(0, 100), PERCENT, percentiles_ms)) / 1000


# The ten people type 40 to 70 words a minute; 3 to 44 % of their touches overlap the next one.
PEOPLE = (
    Times((32, 43, 56, 79, 95, 112, 144, 176, 192), (32, 40, 64, 88, 120, 200, 416, 742, 952)),
    Times((24, 32, 48, 64, 80, 95, 120, 136, 153), (15, 32, 56, 96, 144, 200, 485, 760, 888)),
    Times((36, 47, 60, 76, 89, 104, 124, 140, 156), (30, 60, 87, 139, 192, 294, 617, 900, 983)),
    Times((32, 55, 72, 96, 120, 145, 184, 223, 248), (8, 23, 51, 92, 137, 226, 528, 904, 986)),
    Times((31, 42, 56, 72, 81, 96, 120, 142, 159), (2, 44, 94, 138, 208, 344, 790, 964, 990)),
    Times((20, 44, 57, 74, 95, 122, 164, 195, 224), (12, 36, 60, 100, 148, 235, 581, 873, 983)),
    Times((32, 40, 52, 66, 78, 90, 108, 124, 161), (21, 64, 88, 116, 152, 225, 561, 832, 936)),
    Times((19, 35, 56, 72, 84, 97, 122, 146, 176), (12, 41, 76, 135, 190, 259, 555, 844, 946)),
    Times((40, 60, 82, 112, 132, 157, 203, 236, 291), (35, 50, 81, 131, 191, 313, 705, 938, 991)),
    Times((19, 31, 48, 60, 71, 85, 133, 203, 239), (49, 67, 101, 140, 185, 305, 704, 945, 987)),
)

# Of 22 people, in stretches of 15 touches of about each of these speeds: the duration of a touch
# does not depend on the speed, and intervals vary less at higher speeds.
SPEEDS = 40, 60, 80, 100  # words a minute, of five touches each
_HELD_MS = 29, 40, 56, 72, 88, 108, 144, 177, 216
_SHARES = (  # intervals as shares of their mean
    (0.02, 0.15, 0.28, 0.47, 0.72, 1.29, 2.75, 3.29, 3.56),
    (0.07, 0.17, 0.32, 0.52, 0.77, 1.18, 2.66, 3.97, 4.44),
    (0.07, 0.23, 0.35, 0.59, 0.82, 1.26, 2.14, 3.22, 4.46),
    (0.05, 0.23, 0.41, 0.61, 0.86, 1.31, 2.04, 2.45, 2.88),
)


def at_speed(words_per_min: float) -> Times:
    """Return the times of people who type at a speed; a word has five touches.

    Beyond `SPEEDS`, the intervals vary as at the nearest of these speeds.
    """
    shares = [float(np.interp(words_per_min, SPEEDS, column)) for column in zip(*_SHARES)]
    middles = (np.array(shares[1:]) + shares[:-1]) / 2
    mean = (
        middles @ np.diff(PERCENT) + shares[0] * PERCENT[0] + shares[-1] * (100 - PERCENT[-1])
    ) / 100
    return Times(_HELD_MS, tuple(12_000 / words_per_min / mean * share for share in shares))
