"""The paper's position estimate from two channels, for comparison with six channels."""

from __future__ import annotations

import itertools

import numpy as np
from numpy.polynomial import Chebyshev

from spots.calibrate.fit.presses import Noise, Presses

_CURVE_DEGREE = 7


class OnePair:
    """Estimates the position from the ratio of the two best channels (Eq. 2 of the paper).

    Best are those with the lowest position noise for presses with one force along the whole strip.
    """

    def __init__(self, along: Presses, noise: Noise):
        slopes = np.polyfit(along.position_um, along.logs, 1)[0]
        variance = noise.log_variance(along.counts).mean(axis=0)

        def sigma(pair):
            i, j = pair
            return np.sqrt(variance[i] + variance[j]) / max(abs(slopes[i] - slopes[j]), 1e-12)

        self.channels = min(itertools.combinations(range(len(slopes)), 2), key=sigma)
        self._curve = Chebyshev.fit(self.log_ratio(along.counts), along.position_um, _CURVE_DEGREE)

    def log_ratio(self, counts: np.ndarray) -> np.ndarray:
        """Return the natural logarithm of the ratio of dark-subtracted counts, shape (..., 6)."""
        i, j = self.channels
        return np.log(counts[..., j] / counts[..., i])

    def position_um(self, counts: np.ndarray) -> np.ndarray:
        """Return positions in um, estimated from dark-subtracted counts of shape (..., 6)."""
        return self._curve(self.log_ratio(counts))
