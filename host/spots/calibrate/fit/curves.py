"""Smooth curves of the light along a strip, through presses at some positions."""

from __future__ import annotations

import numpy as np
from numpy.polynomial import Chebyshev


class Curves:
    """Smooth curves of log2 of the counts along the strip, one curve for each of c channels.

    The dark-subtracted counts are those of n presses, `logs` has shape (n, c). The curves are
    polynomials in the position, of at most `degree`. `ends_um` are the first and the last position.
    """

    def __init__(self, position_um: np.ndarray, logs: np.ndarray, degree: int = 7):
        self.ends_um = np.array([position_um.min(), position_um.max()])
        degree = min(degree, len(position_um) // 2)
        self._curves = [Chebyshev.fit(position_um, log, degree) for log in logs.T]

    def logs(self, x_um) -> np.ndarray:
        """Return log2 of the counts at positions `x_um`; shape (..., c) for c channels."""
        return np.stack([curve(np.asarray(x_um, float)) for curve in self._curves], axis=-1)

    def slopes(self, x_um) -> np.ndarray:
        """Return the derivatives of log2(counts) with respect to position, in 1/um, at `x_um`."""
        return np.stack([curve.deriv()(x_um) for curve in self._curves], axis=-1)
