"""Fits a model of a strip's light to presses whose positions and forces have errors.

For a press at the position x with the force F, the model of log2 of the counts of channel c is
``s_c(x) + g(F) + t_c(x, F)``. By Eq. 1 of the paper, position and force act on the
logarithm separately, so t_c is 0 unless the colour of a press depends on its force. `s_c` and `g`
are Chebyshev series whose coefficients have a Gaussian prior. The prior is narrower for higher
degrees, and has a different width for each channel. Uneven dye adds a smooth displacement to x,
the same for all channels (`warp`). Its effect on a channel is in proportion to the slope of `s_c`.
`t_c` is a sum of products of polynomials in
the position and in the square root of the light. It is 0 at a firm press, and so is its mean over
all channels. One part is a shift of the position, which changes the channels in proportion to the
slopes of `s_c`; the other part changes each channel by itself. An error of the position
shifts the channels in proportion to the slopes of `s_c`; an error of the force shifts all channels
alike. The sizes of these errors and of the coefficients are those with the largest evidence
(marginal likelihood; Rasmussen and Williams, Gaussian Processes for Machine Learning, section
5.4.1).
"""

from __future__ import annotations

from dataclasses import InitVar, dataclass, replace
from functools import cached_property
from math import erfc, log

import numpy as np
from numpy.polynomial import chebyshev

from spots_device.sensor.smux import CHANNELS

from . import warp
from .fit import estimators
from .presses import FIRM_MN, FULL_MN, Noise, Presses
from .ruler import common_error_um
from .surface_sizes import CROSSED, USUAL, Sizes

_PLACE, _FORCE = 8, 7  # number of coefficients of s_c and g
_WAVES = 16  # of the displacement w
_CROSS_PLACE, _CROSS_LIGHT = 3, 2  # number of polynomials of t_c in position and light
_APART = np.linalg.svd(np.ones((1, CHANNELS)))[2][1:].T  # differences of channels from their mean
_BENDS = _PLACE * np.arange(CHANNELS) + 2  # indices of the coefficients of degree 2 of s_c
_CONCAVE_MAX = 30.0  # standard deviations; above, erfc() would underflow
_RATIO = 0.3  # ratio of the expected coefficients of successive degrees
_WIDE = 30.0  # log2; expected size of a coefficient that is completely unknown
_UNKNOWN = 4.0  # log2; standard deviation of the light of a press with an unknown force
_STILL = 1 / 12  # counts**2; errors of dark frame and rounding, which more samples do not reduce
_ROUNDS = 3  # iterations of a fit: errors of presses depend on the slopes of the previous iteration
_LIT = 1.0  # least log2 of the counts of the dimmest channel in a press to ask for
_FAR = 0.9  # share of the length; each force to ask for must light all channels at this position
_LEAST_MN = 20.0  # least force that a kitchen scale shows
_LEAST_RELATIVE_MN = 100.0  # least force of a calibration without a scale
_LOWER = 0.6  # least force to ask for, as a share of the least force of all earlier presses
_ABOVE_DARK = 1.15  # least force to ask for, as a multiple of the largest force that was too dark


@dataclass(eq=False)
class Surface:
    """Model of the counts of a strip as a function of position and force, fitted to presses.

    A force of 0 in `taken` means that the force is unknown. `noise` is that of one of the `samples`
    in each reading. The iteration starts from the similar surface `start`, if given. The forces of
    the model are from `least_mN` to `most_mN`. `evidence` is the natural logarithm of the
    probability of the readings in this model, plus a constant.
    """

    taken: Presses
    noise: Noise
    samples: int
    length_um: float
    sizes: Sizes = USUAL
    start: InitVar[Surface | None] = None

    def __post_init__(self, start: Surface | None):
        sizes, known = self.sizes, self.taken.force_mN[self.taken.force_mN > 0]
        self._forces_known = len(known) > 0
        # Not above a firm press, so that the range is not empty.
        self.least_mN = float(known.min(initial=FIRM_MN)) if len(known) else _LEAST_RELATIVE_MN
        self.most_mN = max(FULL_MN, float(known.max(initial=0.0)))
        self._dark_mN = sizes.dark_share * self.least_mN if len(known) else 0.0
        self._low, self._high = np.log(
            [self.least_mN - self._dark_mN, self.most_mN - self._dark_mN]
        )
        bends = np.outer(sizes.bends, _RATIO ** (np.arange(_PLACE) - 2.0))
        rises = sizes.rise * _RATIO ** (np.arange(_FORCE) - 1.0)
        bends[:, :2] = rises[0] = _WIDE
        cross = np.outer(_RATIO ** np.arange(_CROSS_PLACE), _RATIO ** np.arange(_CROSS_LIGHT))
        cross = np.outer([sizes.shift_um, *[sizes.cross] * (CHANNELS - 1)], cross).ravel()
        if not cross.any():
            cross = cross[:0]
        waves = sizes.warp_um * warp.spread(sizes.warp_smooth, _WAVES if sizes.warp_um else 0)
        self._prior = np.concatenate([bends.ravel(), rises, waves, cross])
        self._mean = np.zeros_like(self._prior)
        if start:
            same = CHANNELS * _PLACE + _FORCE
            self._mean[:same] = start._mean[:same]
        for _ in range(1 if start else _ROUNDS):
            self._solve()

    def _solve(self) -> None:
        p = self.taken
        rows = self._rows(p.position_um, p.force_mN) * self._prior
        own = self._own(p.position_um, p.force_mN, p.counts)
        inverse = np.linalg.inv(own)
        weighted = (inverse @ rows).reshape(-1, len(self._prior))
        information = rows.reshape(weighted.shape).T @ weighted + np.eye(len(self._prior))
        units = np.eye(len(self._prior))[:, _BENDS]
        solved = np.linalg.solve(information, np.column_stack([p.logs.ravel() @ weighted, units]))
        found, bends = solved[:, 0], solved[_BENDS]
        self._information, self._mean = information, self._prior * found
        if not self._forces_known:  # a force without a unit is proportional to the light
            self._mean[CHANNELS * _PLACE] = (self._high - self._low) / 2 / np.log(2)
            middle = self._share(np.array([FIRM_MN / 2]))[0]
            self._mean[: CHANNELS * _PLACE : _PLACE] -= self._mean[CHANNELS * _PLACE] * middle
        off = p.logs - rows @ found
        self.evidence = -0.5 * (
            ((inverse @ off[:, :, None])[:, :, 0] * off).sum()
            + found @ found
            + np.linalg.slogdet(information)[1]
            + np.linalg.slogdet(own)[1].sum()
        )
        # A channel receives a band of wavelengths, so its count is a sum of exponentials of the
        # position. The logarithm of this sum is convex, so the prior of the bends is a half-normal
        # distribution. The presses change the probability of a convex curve from 1/2 to erfc() / 2.
        sigmas = bends[:, 0] / np.sqrt(np.diag(bends[:, 1:]))
        self.evidence += sum(log(erfc(-max(sigma, -_CONCAVE_MAX) / 2**0.5)) for sigma in sigmas)

    @cached_property
    def _cov(self) -> np.ndarray:
        """Covariance of the model's coefficients."""
        return np.linalg.inv(self._information) * np.outer(self._prior, self._prior)

    def _rows(self, place_um, force_mN) -> np.ndarray:
        """Return derivatives of log2(counts) with respect to the model's coefficients.

        The arguments are positions in um and forces in mN of n presses; 0 is an unknown force. The
        result has the shape (n, 6, number of coefficients).
        """
        place = chebyshev.chebvander(2 * np.asarray(place_um) / self.length_um - 1, _PLACE - 1)
        force = chebyshev.chebvander(self._share(force_mN), _FORCE)[:, 1:]
        force *= (np.asarray(force_mN) > 0)[:, None]
        channels = np.einsum("ij,nk->nijk", np.eye(CHANNELS), place)
        channels = channels.reshape(len(place), CHANNELS, -1)
        rows = [channels, np.repeat(force[:, None], CHANNELS, axis=1)]
        slopes = self._slopes(place_um)
        if self.sizes.warp_um:
            waves, _ = warp.waves(np.asarray(place_um) / self.length_um, _WAVES)
            rows.append(slopes[:, :, None] * waves[:, None])
        if self.sizes.shift_um or self.sizes.cross:
            light = self._light(force_mN)
            powers = np.stack([light**n - 1 for n in range(1, _CROSS_LIGHT + 1)], axis=1)
            ways = np.broadcast_to(_APART, (len(place), *_APART.shape))
            ways = np.concatenate([(slopes - slopes.mean(1, keepdims=True))[:, :, None], ways], 2)
            cross = np.einsum("nci,nj,nk->ncijk", ways, place[:, :_CROSS_PLACE], powers)
            rows.append(cross.reshape(len(place), CHANNELS, -1))
        return np.concatenate(rows, axis=2)

    @property
    def _rise(self) -> np.ndarray:
        """Coefficients of g, from degree 0."""
        first = CHANNELS * _PLACE
        return np.concatenate([[0.0], self._mean[first : first + _FORCE]])

    def _light(self, force_mN) -> np.ndarray:
        """Return the square root of the light of n forces; 1 for a firm and an unknown force."""
        force_mN = np.where(np.asarray(force_mN) > 0, force_mN, FIRM_MN)
        firm, *logs = chebyshev.chebval(self._share(np.append(FIRM_MN, force_mN)), self._rise)
        return np.exp2((np.array(logs) - firm) / 2)

    def _share(self, force_mN) -> np.ndarray:
        lit = np.log(np.maximum(np.asarray(force_mN) - self._dark_mN, 1.0))
        return (2 * lit - self._low - self._high) / (self._high - self._low)

    def _slopes(self, place_um) -> np.ndarray:
        series = self._mean[: CHANNELS * _PLACE].reshape(CHANNELS, _PLACE).T
        share = 2 * np.asarray(place_um) / self.length_um - 1
        return chebyshev.chebval(share, chebyshev.chebder(series)).T * 2 / self.length_um

    def _rises(self, force_mN) -> np.ndarray:
        """Return the derivatives of log2(counts) with respect to log(force) at n forces."""
        rises = chebyshev.chebval(self._share(force_mN), chebyshev.chebder(self._rise))
        lit = np.maximum(np.asarray(force_mN) - self._dark_mN, 1.0)
        return np.maximum(rises * 2 / (self._high - self._low) * force_mN / lit, 0.1)

    def _own(self, place_um, force_mN, counts) -> np.ndarray:
        """Return the covariance of log2(counts) due to the errors of a press, shape (n, 6, 6).

        The arguments are positions in um, forces in mN and counts of n presses. The errors are
        noise, misfit of the model, and errors of position and force.
        """
        slopes = self._slopes(place_um) * self.sizes.place_um
        weak = self.sizes.force_mN / np.maximum(force_mN, 1.0)
        light = self._rises(force_mN) * np.hypot(self.sizes.force_share, weak)
        light = np.where(np.asarray(force_mN) > 0, light, _UNKNOWN)
        return (
            self._noises(counts)[:, :, None] * np.eye(CHANNELS)
            + slopes[:, :, None] * slopes[:, None, :]
            + (light**2)[:, None, None]
        )

    def _noises(self, counts) -> np.ndarray:
        """Return variances of log2(counts) due to noise and misfit, shape (n, 6)."""
        noise = self.noise.log_variance(counts) / self.samples
        still = _STILL / (np.maximum(counts, 0.1) * np.log(2)) ** 2
        return noise + still + self.sizes.misfit**2

    def logs(self, place_um: np.ndarray, force_mN: np.ndarray) -> np.ndarray:
        """Return log2 of the expected counts of n presses, shape (n, 6)."""
        return self._rows(place_um, force_mN) @ self._mean

    def without(self, press: int) -> Surface:
        """Return the surface fitted to all presses except the one with index `press`."""
        kept = self.taken.keep(np.arange(len(self.taken.force_mN)) != press)
        return replace(self, taken=kept, start=self)

    @cached_property
    def bent(self) -> Surface:
        """Fit of the same presses in which every channel has the largest size in `Sizes.bends`.

        The next press is chosen with this fit, so that a strip whose curves seem straight is also
        pressed between its ends.
        """
        sizes = replace(self.sizes, bends=(max(self.sizes.bends),) * CHANNELS)
        if sizes.shift_um or sizes.cross:
            sizes = replace(sizes, **CROSSED)
        return replace(self, sizes=sizes, start=self)

    def moved(self) -> Surface:
        """Return this fit without the error that all positions have in common, see `ruler`.

        In `taken` of the result, the presses still have the positions that the person read.
        """
        p = self.taken
        place = self._estimators(p.position_um, p.counts)[1]
        off = p.logs - self.logs(p.position_um, p.force_mN)
        noise_um = np.sqrt((self._noises(p.counts) * place**2).sum(axis=1))
        off_um = (off * place).sum(axis=1)
        common_um = common_error_um(p.position_um, off_um, noise_um, self.sizes.place_um)
        presses = replace(p, position_um=p.position_um - common_um)
        moved = replace(self, taken=presses, start=self)
        moved.taken = p
        return moved

    def find(self, counts: np.ndarray) -> tuple[float, float]:
        """Return position in um and force in mN whose expected counts are most like `counts`."""
        place_um = np.linspace(0, self.length_um, 101)
        force_mN = np.geomspace(self.least_mN, self.most_mN, 101)
        off = np.log2(counts) - self.logs(place_um, np.full_like(place_um, FIRM_MN))
        light = off.mean(axis=1)
        best = int(np.argmin(((off - light[:, None]) ** 2).sum(axis=1)))
        by_force = self.logs(np.full_like(force_mN, place_um[best]), force_mN).mean(axis=1)
        nearest = np.argmin(np.abs(by_force - np.log2(counts).mean()))
        return float(place_um[best]), float(force_mN[nearest])

    @cached_property
    def misfits(self) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Comparison of each press with the fit to all other presses: three arrays of shape (n,).

        The first is the squared Mahalanobis distance between the six measured and expected
        log2(counts); the second the position estimated from the counts, minus the measured
        position, in um; the third the force estimated from the counts, divided by the measured
        force, minus 1; 0 if no force was measured.
        """
        p = self.taken
        rows = self._rows(p.position_um, p.force_mN)
        own = self._own(p.position_um, p.force_mN, p.counts)
        rest = own - rows @ self._cov @ rows.transpose(0, 2, 1)
        residual = p.logs - rows @ self._mean
        solved = np.linalg.solve(rest, residual[:, :, None])
        misfit = (residual[:, None] @ solved)[:, 0, 0]
        off = (own @ solved)[:, :, 0]
        force, place = self._estimators(p.position_um, p.counts)
        light = (off * force).sum(axis=1) / self._rises(p.force_mN)
        share = np.where(p.force_mN > 0, np.exp(light.clip(-5, 5)) - 1, 0.0)
        return misfit, (off * place).sum(axis=1), share

    def _estimators(self, place_um, counts):
        slopes = self._slopes(place_um)
        pairs = [
            estimators(np.stack([np.ones(CHANNELS), slope], axis=1), 1 / variance)
            for slope, variance in zip(slopes, self.noise.log_variance(counts))
        ]
        return np.array(pairs).transpose(1, 0, 2)

    def presses(self, place_um: np.ndarray, force_mN: np.ndarray) -> Presses:
        """Return presses without noise, with the counts that this fit expects."""
        counts = 2.0 ** self.logs(place_um, force_mN)
        saturated = np.zeros(len(counts), dtype=bool)
        return Presses(place_um, force_mN, counts, self.noise.variance(counts), saturated)

    def _grid(self, places: int, dark_mN: float = 0.0) -> tuple[np.ndarray, np.ndarray]:
        """Return positions in um and forces in mN of a grid of presses that light all channels.

        The grid has `places` positions. `dark_mN` is as in `next_press`.
        """
        low_mN = max(_LOWER * self.least_mN, _LEAST_MN, _ABOVE_DARK * dark_mN)
        forces_mN = np.geomspace(low_mN, FULL_MN, 12)
        far_um = np.full_like(forces_mN, _FAR * self.length_um)
        lit = self.logs(far_um, forces_mN).min(axis=1) > _LIT
        lit[-1] = True
        forces_mN = forces_mN[lit]
        place_um = np.linspace(0, self.length_um, places)
        return np.tile(place_um, len(forces_mN)), np.repeat(forces_mN, places)

    def _targets(self, place_um, force_mN) -> tuple[np.ndarray, np.ndarray]:
        """Return two matrices, which convert errors of the coefficients to those of presses.

        The first matrix gives errors of the position in um, the second relative errors of the
        force. Each has a row for each press; `place_um` and `force_mN` describe the presses.
        """
        rows = self._rows(place_um, force_mN)
        light, place = self._estimators(place_um, 2.0 ** self.logs(place_um, force_mN))
        light = (rows * light[:, :, None]).sum(axis=1) / self._rises(force_mN)[:, None]
        return (rows * place[:, :, None]).sum(axis=1), light

    def errors(self):
        """Return the expected errors of the positions and forces that the fit gives.

        They are two pairs of arrays: places in um and the standard deviation of each in um; forces
        in mN and the relative standard deviation of each, empty if no force is known.
        """

        def sigma(targets):
            return np.sqrt(np.einsum("ki,ij,kj->k", targets, self._cov, targets))

        place_um = np.linspace(0.05, 0.95, 10) * self.length_um
        places, _ = self._targets(place_um, np.full_like(place_um, FIRM_MN))
        if not self._forces_known:
            return (place_um, sigma(places)), (np.empty(0), np.empty(0))
        force_mN = np.geomspace(self.least_mN, FULL_MN, 8)
        _, forces = self._targets(np.full_like(force_mN, self.length_um / 2), force_mN)
        return (place_um, sigma(places)), (force_mN, sigma(forces))

    def least_lit_mN(self, place_um: float) -> float:
        """Return the least force in mN with more than four counts in all channels at a position.

        If no force gives so much light, return `most_mN`.
        """
        force_mN = np.geomspace(max(_LOWER * self.least_mN, _LEAST_MN), self.most_mN, 60)
        lit = self.logs(np.full_like(force_mN, place_um), force_mN).min(axis=1) > 2 * _LIT
        return float(force_mN[np.argmax(lit)]) if lit.any() else self.most_mN

    def next_press(self, dark_mN: float) -> tuple[float, float]:
        """Return position in um and force in mN of the press that would reduce `errors` most.

        `dark_mN` is the largest force that was too weak to give light in every channel; 0 if there
        is no such force.
        """
        place, force = self._grid(11, dark_mN)
        places, forces = self._targets(place, force)
        crossed = self.sizes.shift_um or self.sizes.cross
        targets = places if crossed else places[force == force.max()], forces
        place, force = self._grid(22, dark_mN)
        counts = 2.0 ** self.logs(place, force)
        rows = self._rows(place, force)
        spread = rows @ self._cov
        total = self._own(place, force, counts) + spread @ rows.transpose(0, 2, 1)
        worth = np.zeros(len(place))
        for rows in targets:
            cross = spread @ rows.T
            gain = np.einsum("nik,nik->n", cross, np.linalg.solve(total, cross))
            worth += gain / np.einsum("ki,ij,kj->", rows, self._cov, rows)
        best = int(np.argmax(worth))
        return float(place[best]), float(force[best])
