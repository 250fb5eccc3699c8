"""The 1-Euro filter: a low pass whose cutoff grows with speed.

Casiez, Roussel and Vogel, 1 Euro Filter: a simple speed-based low-pass filter for noisy input in
interactive systems, CHI 2012, algorithms 1 and 2.
"""

from __future__ import annotations

import math


class OneEuro:
    """Filters one number.

    Parameters
    ----------
    min_cutoff_hz : float
        Cutoff of what stands still: the lower, the calmer.
    beta : float
        How much the cutoff rises with speed, in Hz for a unit of the signal a second: the
        higher, the less it lags.
    derivative_cutoff_hz : float
        Cutoff of the speed.
    """

    def __init__(self, min_cutoff_hz: float, beta: float, derivative_cutoff_hz: float):
        self._min_cutoff_hz = min_cutoff_hz
        self._beta = beta
        self._derivative_cutoff_hz = derivative_cutoff_hz
        self.reset()

    def reset(self) -> None:
        """Forget; the next value comes out as it is."""
        self._value: float | None = None
        self._per_s = 0.0

    def take(self, value: float, dt_s: float) -> float:
        """Filter one value.

        Low-pass filter whose cutoff is ``min_cutoff_hz + beta * |speed|`` (Casiez et al. 2012, "1
        Euro Filter", CHI '12).

        Parameters
        ----------
        value : float
            The new value, in the unit of the signal.
        dt_s : float
            Time since the value before, in seconds; a value with 0 or less is ignored.

        Returns
        -------
        float
            The filtered value; the first value as it is.
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
    """Return the weight of a new value in a first-order low pass."""
    return 1 / (1 + 1 / (2 * math.pi * cutoff_hz * dt_s))
