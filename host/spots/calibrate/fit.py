"""From presses at known places and forces to the integers of a calibration.

Works in L_i = log2 of the dark-subtracted counts, in which Eq. 2 of the paper says that every
channel is a straight line of the position plus the same brightness.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from tactile.calibration import ONE_Q13
from tactile.log2 import ONE as ONE_Q20

from ..errors import SpotsError

_POSITION_KNOTS = 33
_POLYNOMIAL_DEGREE = 5
# Where a touch begins: the position is good to this at the worst place of the strip.
_TOUCH_SIGMA_UM = 500.0
_TOUCH_HYSTERESIS = 0.7
_MISFIT_SIGMAS = 6.0
_ROUNDING_VARIANCE = 1 / 12


@dataclass(frozen=True)
class Presses:
    """Readings of presses that were held.

    Attributes
    ----------
    position_um : numpy.ndarray, shape (n,)
    force_mN : numpy.ndarray, shape (n,)
    counts : numpy.ndarray, shape (n, 6)
        Means of the dark-subtracted counts.
    variance : numpy.ndarray, shape (n, 6)
        Variance of a single sample.
    """

    position_um: np.ndarray
    force_mN: np.ndarray
    counts: np.ndarray
    variance: np.ndarray

    @property
    def logs(self) -> np.ndarray:
        """log2 of the counts, shape (n, 6)."""
        return np.log2(self.counts)

    def log_variance(self) -> np.ndarray:
        """Variance of the log2 of a single sample, shape (n, 6), rounding included."""
        variance = np.maximum(self.variance, _ROUNDING_VARIANCE)
        return variance / (self.counts * np.log(2)) ** 2


@dataclass(frozen=True)
class Conditions:
    """What a calibration belongs to, as the board's ``hello`` tells it."""

    board: str
    plan: tuple[str, ...]
    gain: int
    exposure_us: int
    led_mA: int


def fit(along: Presses, pressed: Presses, conditions: Conditions) -> list[str]:
    """Return the lines of a calibration, see `tactile.calibration`.

    Parameters
    ----------
    along : Presses
        One firm force at places along the whole strip.
    pressed : Presses
        Ascending forces, each at the same few places.
    conditions : Conditions

    Raises
    ------
    SpotsError
        If the readings are too few or too dark for a calibration.
    """
    if len(along.position_um) < 2 * _POLYNOMIAL_DEGREE:
        raise SpotsError(f"a calibration needs presses at {2 * _POLYNOMIAL_DEGREE} places or more")
    if (along.counts <= 0).any():
        raise SpotsError("a press was too dark to use: press harder, or raise exposure or gain")
    slope = np.polyfit(along.position_um / 1000, along.logs, 1)[0]
    noise = along.log_variance().mean(axis=0)
    position = _position_weights(slope, noise)
    force = _force_weights(along.logs, noise)
    test = _fit_weights(slope, noise)
    pressed = _lit(pressed)
    lines = [
        "board " + conditions.board,
        "plan " + " ".join(conditions.plan),
        f"made {conditions.gain} {conditions.exposure_us} {conditions.led_mA}",
        _statement("position", position),
        _statement("force", force),
        _statement("fit", test),
    ]
    knots = _position_knots(along, position, test)
    forces, brightnesses = _force_table(pressed, force)
    begin = _touch_force_mN(pressed, position, knots)
    end = max(round(_TOUCH_HYSTERESIS * begin), round(forces[0]) + 1)
    lines.append(f"touch {max(begin, end)} {end}")
    lines += [_statement("x", knot) for knot in knots]
    tolerances = _tolerances(pressed, position, test, knots)
    lines += [_statement("f", map(round, knot)) for knot in zip(brightnesses, forces, tolerances)]
    return lines


def _statement(name: str, integers) -> str:
    return " ".join([name, *(str(int(value)) for value in integers)])


def _weights_q13(weights: np.ndarray, total: int) -> np.ndarray:
    # Rounded so that they add up exactly; the largest takes what rounding left.
    rounded = np.round(weights * ONE_Q13).astype(int)
    rounded[np.argmax(np.abs(rounded))] += total - rounded.sum()
    return rounded


def _position_weights(slope: np.ndarray, noise: np.ndarray) -> np.ndarray:
    # Least variance for a unit of slope, under sum w = 0.
    inverse = 1 / noise
    weights = inverse * (slope - (inverse @ slope) / inverse.sum())
    return _weights_q13(2 * weights / np.abs(weights).sum(), 0)


def _force_weights(logs: np.ndarray, noise: np.ndarray) -> np.ndarray:
    # Least variance of the brightness over the whole strip at one force, under sum v = 1: what is
    # left of the decay and of its curvature counts as noise.
    spread = np.cov(logs.T) + np.diag(noise)
    weights = np.linalg.solve(spread, np.ones(len(noise)))
    return _weights_q13(weights / weights.sum(), ONE_Q13)


def _fit_weights(slope: np.ndarray, noise: np.ndarray) -> np.ndarray:
    # Light of two places adds up to more than any one place gives, in second order by slope**2:
    # the generalised least squares estimate of that part, blind to brightness and position.
    design = np.stack([np.ones_like(slope), slope, slope**2], axis=1)
    weighted = design / noise[:, None]
    weights = np.linalg.solve(design.T @ weighted, weighted.T)[2]
    return _weights_q13(2 * weights / np.abs(weights).sum(), 0)


def _position_knots(along: Presses, position: np.ndarray, test: np.ndarray) -> np.ndarray:
    x = along.position_um
    centre, half = (x.max() + x.min()) / 2, (x.max() - x.min()) / 2
    at = np.linspace(x.min(), x.max(), _POSITION_KNOTS)

    def smooth(weights):
        values = along.logs @ weights * (ONE_Q20 / ONE_Q13)
        polynomial = np.polyfit((x - centre) / half, values, _POLYNOMIAL_DEGREE)
        return np.polyval(polynomial, (at - centre) / half)

    knots = np.round(np.stack([smooth(position), at, smooth(test)], axis=1)).astype(int)
    return knots[np.argsort(knots[:, 0])]


def _lit(pressed: Presses) -> Presses:
    keep = (pressed.counts > 1).all(axis=1)
    dark = pressed.force_mN[~keep]
    if len(dark):  # a force counts only where every place saw it
        keep &= pressed.force_mN > dark.max()
    if len(np.unique(pressed.force_mN[keep])) < 2:
        raise SpotsError("no force gave light at every place: press harder, or raise the gain")
    return Presses(*(array[keep] for array in vars(pressed).values()))


def _force_table(pressed: Presses, force: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    brightness = pressed.logs @ force * (ONE_Q20 / ONE_Q13)
    forces = np.unique(pressed.force_mN)
    means = np.array([brightness[pressed.force_mN == f].mean() for f in forces])
    if (np.diff(means) <= 0).any():
        raise SpotsError("the light does not grow with the force: check strip, LED and saturation")
    return forces, means


def _touch_force_mN(pressed: Presses, position: np.ndarray, knots: np.ndarray) -> int:
    # Position noise at each force, at the worst place: that of the contrast over its slope there.
    um_per_contrast = np.abs(np.diff(knots[:, 1]) / np.diff(knots[:, 0])).max()
    sigma_q20 = np.sqrt(pressed.log_variance() @ position.astype(float) ** 2) / ONE_Q13 * ONE_Q20
    for f in np.unique(pressed.force_mN):
        if sigma_q20[pressed.force_mN == f].max() * um_per_contrast <= _TOUCH_SIGMA_UM:
            return round(f)
    raise SpotsError(
        "the position is too noisy at every force: raise exposure, gain or LED current"
    )


def _tolerances(pressed, position, test, knots) -> list[int]:
    # At each force: how far a single press was off at worst, and noise, which falls as light grows.
    scale = ONE_Q20 / ONE_Q13
    expected = np.interp(pressed.logs @ position * scale, knots[:, 0], knots[:, 2])
    residual = np.abs(pressed.logs @ test * scale - expected)
    sigma = np.sqrt(pressed.log_variance() @ test.astype(float) ** 2) * scale
    off = residual + _MISFIT_SIGMAS * sigma
    return [1 + round(off[pressed.force_mN == f].max() / 2**8) for f in np.unique(pressed.force_mN)]
