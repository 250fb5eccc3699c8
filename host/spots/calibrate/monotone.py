"""Interpolation that rises wherever its points rise (Fritsch and Carlson, 1980)."""

from __future__ import annotations

import numpy as np


def monotone(x: np.ndarray, y: np.ndarray, at: np.ndarray) -> np.ndarray:
    """Return the piecewise cubic through rising points, without a bend that they do not have.

    Parameters
    ----------
    x, y : numpy.ndarray, shape (n,)
        Points, both coordinates ascending, n at least 3.
    at : numpy.ndarray
        Where, within the points.

    Returns
    -------
    numpy.ndarray
        Shape of `at`.
    """
    step = np.diff(x)
    secant = np.diff(y) / step
    # Inside, the weighted harmonic mean of the two secants; at an end, that of the end.
    before, after = 2 * step[1:] + step[:-1], step[1:] + 2 * step[:-1]
    inner = (before + after) / (before / secant[:-1] + after / secant[1:])
    slope = np.concatenate([secant[:1], inner, secant[-1:]])
    i = np.clip(np.searchsorted(x, at, side="right") - 1, 0, len(step) - 1)
    t = (at - x[i]) / step[i]
    rise = (y[i + 1] - y[i]) * t**2 * (3 - 2 * t)
    bend = step[i] * t * (1 - t) * (slope[i] * (1 - t) - slope[i + 1] * t)
    return y[i] + rise + bend
