"""The 1-Euro filter: a low-pass filter whose cutoff frequency rises with the signal's speed.

Casiez, Roussel and Vogel, 1 Euro Filter: a simple speed-based low-pass filter for noisy input in
interactive systems, CHI 2012, algorithms 1 and 2.
"""

import math


class OneEuro:
    """1-Euro filter of one signal.

    `min_cutoff_hz` is the cutoff frequency for a constant signal: a lower value reduces jitter.
    `beta` is its increase, in Hz, for a speed of one signal unit per second: a higher value reduces
    lag. `derivative_cutoff_hz` is that of the low-pass filter of the speed.
    """

    def __init__(self, min_cutoff_hz: float, beta: float, derivative_cutoff_hz: float):
        self._min_cutoff_hz = min_cutoff_hz
        self._beta = beta
        self._derivative_cutoff_hz = derivative_cutoff_hz
        self.reset()

    def reset(self) -> None:
        """Reset the filter; the next sample is returned unfiltered."""
        self._value: float | None = None
        self._per_s = 0.0

    def take(self, value: float, dt_s: float) -> float:
        """Filter a new sample, with the cutoff frequency ``min_cutoff_hz + beta * |speed|``.

        A sample with `dt_s` of 0 or less is ignored. The first one after a reset is returned
        unfiltered.
        """
        if self._value is None:
            self._value = value
        elif dt_s > 0:
            per_s = (value - self._value) / dt_s
            self._per_s += _alpha(self._derivative_cutoff_hz, dt_s) * (per_s - self._per_s)
            cutoff_hz = self._min_cutoff_hz + self._beta * abs(self._per_s)
            self._value += _alpha(cutoff_hz, dt_s) * (value - self._value)
        return self._value


def _alpha(cutoff_hz: float, dt_s: float) -> float:
    """Return the weight (0 to 1) of a new sample in a low-pass filter."""
    return 1 / (1 + 1 / (2 * math.pi * cutoff_hz * dt_s))
