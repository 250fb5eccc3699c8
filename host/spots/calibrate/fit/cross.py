"""Fits the cross-sensitivity: how the spectrum of a press depends on its force.

A firm press closes gaps between the light guides that a weak press leaves, and excites other modes
of the dyed guide. Both change the ratios of the channels, which a board takes for another position.
The presses with different forces at a few positions show this change. It is fitted as a function
of position and brightness. The brightness shows the contact better than the force does, because the
silicone creeps and a scale is not exact.
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import product

import numpy as np
from numpy.polynomial import chebyshev
from numpy.typing import ArrayLike

from .presses import Noise, Presses

_PLACES = 3  # largest number of coefficients of the change as a polynomial in the position
_LIGHTS = 5  # largest degree of the change as a polynomial in the brightness
# Standard deviation of the dark frame's error in counts. The counts in the dark are integers with
# little noise, so the error of their mean is up to 0.2 counts.
_DARK_COUNTS = 0.1
_ROUNDS = 4  # rounds of the reweighted least squares
_LEAST_SCALE = 1e-6  # least variance of the residuals, in units of the noise of one sample


@dataclass(frozen=True)
class Change:
    """Change of log2 of the counts with the force, relative to firm presses along the strip.

    `lights` are the least and the largest brightness of the presses in log2 units; that of a firm
    press is 0. `coefficients`, shape (c, places, lights), are those of the polynomials in position
    and brightness, for each of c channels.
    """

    ends_um: np.ndarray
    lights: tuple[float, float]
    coefficients: np.ndarray

    def logs(self, x_um: ArrayLike, light: ArrayLike) -> np.ndarray:
        """Return the changes of log2 of the counts of presses, shape (..., c).

        Positions and brightnesses have the same shape (...). The mean of the channels is 0, because
        a change of all channels is one of the force.
        """
        places = _places(self.ends_um, x_um, self.coefficients.shape[1])
        lights = _lights(self.lights, light, self.coefficients.shape[2])
        return np.einsum("...a,...b,cab->...c", places, lights, self.coefficients)


def change(
    pressed: Presses,
    off: np.ndarray,
    light: np.ndarray,
    slopes: np.ndarray,
    noise: Noise,
    ends_um: np.ndarray,
) -> Change | None:
    """Fit the change of the spectrum with the force; None if noise explains the differences.

    `pressed` are n presses with different forces at a few positions, with light in all channels.
    `off`, shape (n, c), is log2 of their counts minus that of firm presses at the same positions;
    `light` is their brightness in log2 units, relative to firm presses. `slopes`, shape (n, c), are
    derivatives of log2 of the counts by the position in um.
    """
    count = min(_PLACES, len(np.unique(pressed.position_um)))
    degree = min(_LIGHTS, len(light) // (2 * count) - 1)
    if degree < 1:
        return None
    bounds = float(light.min()), float(light.max())
    places, lights = _places(ends_um, pressed.position_um, count), _lights(bounds, light, degree)
    # A constant at each position: the firm presses were not made at the same time.
    lights = np.column_stack([np.ones(len(light)), lights])
    basis = np.einsum("na,nb->nab", places, lights).reshape(len(light), -1)
    channels = off.shape[1]
    # Channels that differ from the mean of all channels.
    apart = np.linalg.svd(np.ones((1, channels)))[2][1:].T
    design = np.einsum("ci,nb->ncib", apart, basis).reshape(*off.shape, -1)
    # The error of the dark frame, in units of its standard deviation: a constant of each channel.
    error = _DARK_COUNTS / (pressed.counts * np.log(2))
    design = np.concatenate([error[:, :, None] * np.eye(channels), design], axis=2)
    # Of each press, the mean of the channels is the light, and is free. The next direction is that
    # of the slopes, along which the error of the press's position adds to the noise.
    sigma = np.sqrt(noise.log_variance(pressed.counts))
    frames = _frames(1 / sigma, slopes / sigma)
    rows = np.einsum("nrc,nck->nrk", frames, design / sigma[:, :, None])
    values = np.einsum("nrc,nc->nr", frames, off / sigma)
    lever = np.einsum("nc,nc->n", frames[:, 0], slopes / sigma) ** 2
    left = 1 - rows.shape[-1] / values.size  # share of the degrees of freedom
    variance = np.ones(values.shape)
    for _ in range(_ROUNDS):
        _, residual = _solved(rows, values, variance)
        scale = max(float((residual[:, 1:] ** 2).mean()) / left, _LEAST_SCALE)
        excess = (residual[:, 0] ** 2 / left - scale) * lever / variance[:, 0] ** 2
        place_um2 = max(float(excess.sum() / (lever**2 / variance[:, 0] ** 2).sum()), 0.0)
        variance = np.full(values.shape, scale)
        variance[:, 0] += place_um2 * lever
    # Polynomials of different degrees. One must explain the presses better than no change does, by
    # the Bayesian information criterion. Then the best by Akaike's criterion is used: a change that
    # is certain may have many coefficients.
    place, power = np.divmod(np.arange(basis.shape[1]), degree + 1)
    fits = []
    for most_places, most_power in [(0, 0), *product(range(1, count + 1), range(1, degree + 1))]:
        used = (power == 0) | ((place < most_places) & (power <= most_power))
        columns = np.concatenate([np.full(channels, True), np.tile(used, channels - 1)])
        found, residual = _solved(rows[:, :, columns], values, variance)
        fits.append((float((residual**2 / variance).sum()), columns, found))
    if min(fits, key=lambda fit: fit[0] + np.log(values.size) * len(fit[2])) is fits[0]:
        return None
    _, columns, found = min(fits, key=lambda fit: fit[0] + 2 * len(fit[2]))
    coefficients = np.zeros(rows.shape[-1])
    coefficients[columns] = found
    shape = channels, count, degree + 1
    coefficients = apart @ coefficients[channels:].reshape(channels - 1, -1)
    coefficients = coefficients.reshape(shape)[:, :, 1:]
    return Change(np.asarray(ends_um), bounds, coefficients)


def _solved(rows, values, variance):
    """Solve a weighted least-squares problem; return unknowns and residuals.

    The first unknowns, one for each channel, have an expected value of 0 and a variance of 1.
    """
    weight = 1 / np.sqrt(variance)
    known = np.eye(rows.shape[1] + 1, rows.shape[2])
    flat = np.concatenate([(rows * weight[:, :, None]).reshape(-1, rows.shape[2]), known])
    aims = np.concatenate([(values * weight).ravel(), np.zeros(len(known))])
    found = np.linalg.lstsq(flat, aims, rcond=None)[0]
    return found, values - rows @ found


def _frames(ones: np.ndarray, slopes: np.ndarray) -> np.ndarray:
    """Return c - 1 unit vectors for each press, at right angles to `ones` and to each other.

    The first vector has the direction of `slopes`, as far as that is at right angles to `ones`.
    """
    full, _ = np.linalg.qr(np.stack([ones, slopes], axis=2), mode="complete")
    return full.transpose(0, 2, 1)[:, 1:]


def _places(ends_um, x_um, count: int) -> np.ndarray:
    share = 2 * (np.asarray(x_um, float) - ends_um[0]) / np.ptp(ends_um) - 1
    return chebyshev.chebvander(share, count - 1)


def _lights(bounds: tuple[float, float], light, degree: int) -> np.ndarray:
    """Return polynomials in the brightness: 0 for a firm press, constant beyond `bounds`."""
    # In the square root of the light, weak presses are neither all alike nor far from firm ones.
    low, high = np.exp2(np.array(bounds) / 2)

    def polynomials(light):
        share = 2 * (np.exp2(light / 2).clip(low, high) - low) / (high - low) - 1
        return chebyshev.chebvander(share, degree)

    return (polynomials(np.asarray(light, float)) - polynomials(np.zeros(())))[..., 1:]
