"""The paper's estimate by one pair of channels, to compare six channels with."""

from __future__ import annotations

import itertools

import numpy as np
from numpy.polynomial import Chebyshev

from spots.calibrate.presses import Noise, Presses

_CURVE_DEGREE = 7


class OnePair:
    """Position from ln of the ratio of two channels (Eq. 2 of the paper), here the best two.

    Parameters
    ----------
    along : Presses
        One force at places along the whole strip.
    noise : Noise

    Attributes
    ----------
    channels : tuple of int
        The pair with the least noise for its slope.
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
        """Return ln of the ratio of the two channels of dark-subtracted counts."""
        i, j = self.channels
        return np.log(counts[..., j] / counts[..., i])

    def position_um(self, counts: np.ndarray) -> np.ndarray:
        """Return the position by this pair alone."""
        return self._curve(self.log_ratio(counts))
