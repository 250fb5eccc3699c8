"""Smooth curves of the light along a strip, through presses at some positions."""

from __future__ import annotations

import numpy as np
from numpy.polynomial import chebyshev

from . import warp
from .presses import Noise, Presses

_DEGREE, _STIFF = 4, 3  # of the polynomials: at last, and before a displacement is known
_WAVES = 28  # of the displacement
_WARPED = 12  # least number of positions for a displacement
_ROUNDS = 6  # iterations: the effect of a displacement depends on the slopes of the curves
# Displacements that are tried, as shares of the length: standard deviation if the noise is that of
# `variance` (in proportion larger if the noise is less; 0 is none), and distance of smoothness. A
# limit of the former keeps curves through presses without noise definite.
_SIZES = np.append(0.0, 2.0 ** np.arange(-14, 1))
_LARGEST = 0.01  # largest standard deviation of a displacement; presses at wrong places have more
_LEAST = 1e-12  # least squared errors, as a share of the squared values: rounding
_SMOOTH = 0.05, 0.08, 0.12, 0.18, 0.27, 0.4


class Curves:
    """Smooth curves of log2 of the counts along the strip, one curve for each of c channels.

    The counts of n presses are dark-subtracted. `logs`, shape (n, c), has their log2, and
    `variance` the variances of `logs`, times any factor. `ends_um` are the first and the last
    position. A curve is a polynomial of a low degree in a displaced position. The displacement is
    the same for all channels, because uneven dye changes all channels alike. Its size and
    smoothness are those with the largest evidence (marginal likelihood); without evidence for it,
    it is 0. Only ratios of the channels count for it, because they do not depend on the force.
    """

    def __init__(self, position_um: np.ndarray, logs: np.ndarray, variance: np.ndarray):
        self.ends_um = np.array([position_um.min(), position_um.max()])
        self._waves = np.zeros(_WAVES)
        presses = position_um, logs, np.sqrt(variance)
        # The first slopes are those of stiff curves, which do not follow a displacement.
        self._fit(*presses, min(_STIFF, len(position_um) // 2))
        for _ in range(_ROUNDS if len(position_um) >= _WARPED else 0):
            self._fit(*presses, _DEGREE, has_waves=True)
        self._fit(*presses, min(_DEGREE, len(position_um) // 2))

    @classmethod
    def of(cls, presses: Presses, noise: Noise) -> Curves:
        """Return curves through presses with the same force."""
        return cls(presses.position_um, presses.logs, noise.log_variance(presses.counts))

    def logs(self, x_um) -> np.ndarray:
        """Return log2 of the counts at positions `x_um`; shape (..., c) for c channels."""
        place, _ = self._displaced(x_um)
        return np.moveaxis(chebyshev.chebval(place, self._series), 0, -1)

    def slopes(self, x_um) -> np.ndarray:
        """Return the derivatives of log2(counts) with respect to position, in 1/um, at `x_um`."""
        place, stretch = self._displaced(x_um)
        slopes = chebyshev.chebval(place, chebyshev.chebder(self._series))
        return np.moveaxis(slopes * stretch * 2 / np.ptp(self.ends_um), 0, -1)

    def _displaced(self, x_um) -> tuple[np.ndarray, np.ndarray]:
        """Return displaced positions, from -1 to 1, and their derivatives by the position."""
        share = (np.asarray(x_um, float) - self.ends_um[0]) / np.ptp(self.ends_um)
        waves, slopes = warp.waves(share, _WAVES)
        return 2 * (share + waves @ self._waves) - 1, 1 + slopes @ self._waves

    def _fit(self, position_um, logs, sigma, degree: int, has_waves: bool = False) -> None:
        """Fit polynomials of a degree and, with `has_waves`, the displacement."""
        places, channels = logs.shape
        size, scale = places * channels, 1 / sigma[:, :, None]
        place, _ = self._displaced(position_um)
        # Unknown are the light of each press, and polynomials whose mean over the channels is 0.
        apart = np.linalg.svd(np.ones((1, channels)))[2][1:].T
        powers = chebyshev.chebvander(place, degree)
        lights = np.repeat(np.eye(places)[:, None], channels, axis=1)
        shapes = np.einsum("nd,ci->ncdi", powers, apart).reshape(places, channels, -1)
        others = (np.concatenate([lights, shapes], axis=2) * scale).reshape(size, -1)
        values = logs
        if has_waves:
            slopes = 2 * chebyshev.chebval(place, chebyshev.chebder(self._series)).T
            waves, _ = warp.waves((position_um - self.ends_um[0]) / np.ptp(self.ends_um), _WAVES)
            rows = slopes[:, :, None] * waves[:, None]
            values = logs + rows @ self._waves
            explained, _ = np.linalg.qr(others)
            seen = np.column_stack([(rows * scale).reshape(size, -1), (values / sigma).ravel()])
            seen -= explained @ (explained.T @ seen)
            self._waves = _likeliest(seen[:, :-1], seen[:, -1], size - others.shape[1])
            values = values - rows @ self._waves
        found = np.linalg.lstsq(others, (values / sigma).ravel())[0]
        light, shape = found[:places], found[places:].reshape(degree + 1, channels - 1)
        common = np.linalg.lstsq(powers, light)[0]
        self._series = shape @ apart.T + common[:, None]


def _likeliest(rows: np.ndarray, values: np.ndarray, count: int) -> np.ndarray:
    """Return the waves' coefficients, with the size and smoothness of the largest evidence.

    `values` are ``rows`` times the coefficients, plus `count` independent errors of one unknown
    size.
    """
    best, found = -np.inf, np.zeros(rows.shape[1])
    total = values @ values
    for smooth in _SMOOTH:
        spread = warp.spread(smooth, rows.shape[1])
        powers, ways = np.linalg.eigh((rows * spread).T @ (rows * spread))
        powers, seen = powers.clip(0), ways.T @ (spread * (values @ rows))
        for size in _SIZES:
            gain = size**2 / (1 + size**2 * powers)
            off = max(total - gain @ seen**2, _LEAST * total)
            evidence = -count * np.log(off) - np.log1p(size**2 * powers).sum()
            small = size**2 * off / count <= _LARGEST**2
            if small and evidence > best:
                best, found = evidence, spread * (ways @ (gain * seen))
    return found
