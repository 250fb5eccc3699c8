"""A smooth displacement of colours along a strip, as unevenly mixed dye causes it.

More dye at one place shifts the colours of all presses beyond this place, and in all channels
alike. The displacement is a Gaussian process with a Matern 5/2 kernel, as a sum of sine waves with
Gaussian coefficients (Solin and Sarkka, Hilbert space methods for reduced-rank Gaussian process
regression, Statistics and Computing 30, 2020).
"""

from __future__ import annotations

import numpy as np

_BEYOND = 0.15  # the waves end at this distance from the strip's ends; its length is 1


def waves(share: np.ndarray, count: int) -> tuple[np.ndarray, np.ndarray]:
    """Return `count` waves at n positions, and their derivatives by the position; (n, count).

    Positions are shares of the strip's length.
    """
    rates = _rates(count)
    angle = (np.asarray(share, float) + _BEYOND)[..., None] * rates
    scale = np.sqrt(2 / (1 + 2 * _BEYOND))
    return scale * np.sin(angle), scale * rates * np.cos(angle)


def spread(smooth: float, count: int) -> np.ndarray:
    """Return the standard deviation of each wave's coefficient for a displacement of size 1.

    Displacements at positions nearer to each other than `smooth`, a share of the length, are alike.
    """
    rate = 5**0.5 / smooth
    return np.sqrt(16 / 3 * rate**5 / (rate**2 + _rates(count) ** 2) ** 3)


def _rates(count: int) -> np.ndarray:
    return np.pi * np.arange(1, count + 1) / (1 + 2 * _BEYOND)
