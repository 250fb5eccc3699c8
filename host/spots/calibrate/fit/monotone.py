"""Monotone cubic interpolation (Fritsch and Carlson, 1980)."""

from __future__ import annotations

import numpy as np


def monotone(x: np.ndarray, y: np.ndarray, at: np.ndarray) -> np.ndarray:
    """Interpolate rising points by a piecewise cubic curve that rises everywhere.

    Both coordinates of the 3 or more points ascend; `at` is between the first and the last point.
    """
    step = np.diff(x)
    secant = np.diff(y) / step
    # The slope at a point is a weighted harmonic mean of its two secants. At an end, it is the
    # slope of the parabola through the three nearest points, limited so that the curve rises.
    before, after = 2 * step[1:] + step[:-1], step[1:] + 2 * step[:-1]
    inner = (before + after) / (before / secant[:-1] + after / secant[1:])
    bend = step[[0, -1]] * np.diff(secant)[[0, -1]] / (step[[0, -1]] + step[[1, -2]])
    first, last = (secant[[0, -1]] - bend * (1, -1)).clip(0, 3 * secant[[0, -1]])
    slope = np.concatenate([[first], inner, [last]])
    i = np.clip(np.searchsorted(x, at, side="right") - 1, 0, len(step) - 1)
    t = (at - x[i]) / step[i]
    rise = (y[i + 1] - y[i]) * t**2 * (3 - 2 * t)
    bend = step[i] * t * (1 - t) * (slope[i] * (1 - t) - slope[i + 1] * t)
    return y[i] + rise + bend
