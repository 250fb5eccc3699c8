"""From presses at known places and forces to the integers of a calibration.

Works in L_i = log2 of the dark-subtracted counts. Near any place, Eq. 1 of the paper makes them a
straight line of position and logarithm of the light, and generalised least squares with the noise
of each channel gives the best linear estimate of both: its two rows are the weights of that
segment of the strip.
"""

from __future__ import annotations

import numpy as np
from numpy.polynomial import Chebyshev

from spots_device.calibration import ONE_Q13, WEIGHT_SUM_MAX, Conditions
from spots_device.log2 import ONE as ONE_Q20

from ..errors import SpotsError
from .monotone import monotone
from .presses import Noise, Presses

SEGMENTS = 5
_KNOTS = 9  # of a segment
_OVERLAP = 0.25  # of a segment, that its table reaches into its neighbours
_CURVE_DEGREE = 7
_FORCE_KNOTS = 72
_FORCE_SUM_MAX = 0.99 * WEIGHT_SUM_MAX / ONE_Q13  # of the weights' absolute values
PLACES_MIN = 12
FORCES_MIN = 10
# Where a touch begins: the position is good to this at the worst place of the strip.
_TOUCH_SIGMA_UM = 500.0
_TOUCH_HYSTERESIS = 0.7
_MISFIT_SIGMAS = 6.0
_PRODUCT_MAX = 2.0**28  # a quarter of what fits 31 bits, for bends and for strain
_TOLERANCE_MIN = 12  # Q12; an LED cools by 1 or 2 K in a dark frame: 10 um on 85 mm
_TOLERANCE_MAX = 600  # Q12; light so dim shows no second press anyway
_Q13_TO_Q20 = ONE_Q20 / ONE_Q13


def fit(
    along: dict[int, Presses], pressed: Presses, noise: Noise, conditions: Conditions
) -> list[str]:
    """Return the lines of a calibration, see `spots_device.calibration`.

    Parameters
    ----------
    along : dict of int to Presses
        Presses of one firm force along the whole strip, by strain in ppm; 0 must be among them.
        Places are measured on the stretched strip.
    pressed : Presses
        Ascending forces, each at the same few places, at no strain.
    noise : Noise
        Noise of the sensor at these conditions.
    conditions : Conditions

    Returns
    -------
    list of str

    Raises
    ------
    SpotsError
        If the readings are too few, too dark, saturated or not monotone.
    """
    _check(along[0], pressed)
    curves = {strain: Curves(presses) for strain, presses in sorted(along.items())}
    rest = curves[0]
    coarse, _ = _weights(rest, noise, rest.x_um)
    test = _fit_weights(rest, noise)
    parts = [_weights(rest, noise, part) for part in _parts(rest)]
    lines = [
        "board " + conditions.board,
        "plan " + " ".join(conditions.plan),
        f"made {conditions.gain} {conditions.exposure_us} {conditions.led_mA}",
        _statement("coarse", coarse),
        _statement("fit", test),
    ]
    lines += [_statement("segment", [*position, *force]) for position, force in parts]
    firm = rest.logs(_middle(rest)) @ _part_at(rest, parts, _middle(rest))[1] * _Q13_TO_Q20
    blocks = []
    for strain, curve in curves.items():
        blocks.append(f"strain {strain}")
        for (position, force), part in zip(parts, _parts(curve)):
            blocks.append(f"from {round(float(curve.logs(part[0]) @ coarse) * _Q13_TO_Q20)}")
            blocks += _knots(curve, part, position, force, test, firm)
    forces, brightnesses = _force_table(rest, parts, pressed, firm)
    begin = _touch_force_mN(rest, parts, noise, forces, brightnesses, firm)
    end = max(round(_TOUCH_HYSTERESIS * begin), round(float(forces[0])) + 1)
    lines.append(f"touch {max(begin, end)} {end}")
    tolerances = _tolerances(along[0], rest, noise, test, brightnesses, firm)
    for knot in zip(brightnesses, forces, tolerances):
        lines.append(_statement("f", knot))
    return lines + blocks


class Curves:
    """log2 of the counts along the strip, smoothed channel by channel.

    Attributes
    ----------
    x_um : numpy.ndarray
        The two ends.
    """

    def __init__(self, along: Presses):
        x = along.position_um
        self.x_um = np.array([x.min(), x.max()])
        degree = min(_CURVE_DEGREE, len(x) // 2)
        self._curves = [Chebyshev.fit(x, log, degree) for log in along.logs.T]
        self._slopes = [curve.deriv() for curve in self._curves]

    def logs(self, x_um) -> np.ndarray:
        """Return L at places, shape (..., 6)."""
        return np.stack([curve(np.asarray(x_um, float)) for curve in self._curves], axis=-1)

    def slopes(self, x_um) -> np.ndarray:
        """Return dL/dx per um at places, shape (..., 6)."""
        return np.stack([slope(np.asarray(x_um, float)) for slope in self._slopes], axis=-1)


def _check(along: Presses, pressed: Presses) -> None:
    if len(np.unique(along.position_um)) < PLACES_MIN:
        raise SpotsError(f"a calibration needs presses at {PLACES_MIN} places or more")
    if len(np.unique(pressed.force_mN)) < FORCES_MIN:
        raise SpotsError(f"a calibration needs {FORCES_MIN} forces or more")
    dark = (along.counts < 1).any(axis=1)
    if dark.any():
        where = along.position_um[dark][0] / 1000
        raise SpotsError(f"the press at {where:g} mm is too dark: press harder, or raise the gain")
    for presses in (along, pressed):
        full = presses.saturated
        if full.any():
            where = presses.position_um[full][0] / 1000
            raise SpotsError(
                f"the press at {where:g} mm is saturated: run 'auto', or lower the gain"
            )


def _statement(name: str, values) -> str:
    return " ".join([name, *(str(round(float(value))) for value in values)])


def _middle(curve: Curves) -> float:
    return float(curve.x_um.mean())


def _parts(curve: Curves) -> list[np.ndarray]:
    borders = np.linspace(*curve.x_um, SEGMENTS + 1)
    return [borders[k : k + 2] for k in range(SEGMENTS)]


def _part_at(curve: Curves, parts, x_um: float):
    share = (x_um - curve.x_um[0]) / np.ptp(curve.x_um)
    return parts[min(max(int(share * SEGMENTS), 0), SEGMENTS - 1)]


def _weights_q13(weights: np.ndarray, total: int) -> np.ndarray:
    # Rounded so that they add up exactly; the largest takes what rounding left.
    rounded = np.round(weights * ONE_Q13).astype(int)
    rounded[np.argmax(np.abs(rounded))] += total - rounded.sum()
    return rounded


def _weights(curve: Curves, noise: Noise, part) -> tuple[np.ndarray, np.ndarray]:
    """Return the weights for position and force that are best in the middle of a part."""
    middle = float(np.mean(part))
    counts = 2.0 ** curve.logs(middle)
    information = 1 / noise.log_variance(counts)
    # The slope over the whole part, so that the force cancels there on average.
    slope = curve.logs(part[1]) - curve.logs(part[0])
    design = np.stack([np.ones_like(slope), slope / np.abs(slope).max()], axis=1)
    weighted = design * information[:, None]
    force, position = np.linalg.solve(design.T @ weighted, weighted.T)
    position *= 2 / np.abs(position).sum()
    # Where all channels decay nearly alike, weights that cancel the decay are large. Up to the
    # board's limit they cancel a part, and the table of offsets has the rest.
    brightest, size = information / information.sum(), np.abs(force).sum()
    if size > _FORCE_SUM_MAX:
        force = brightest + (force - brightest) * (_FORCE_SUM_MAX - 1) / (size - 1)
    # The board multiplies a step of the contrast by one of the position: where both are long, the
    # contrast is made smaller. What it loses in resolution it had too much.
    knot_um = np.ptp(part) * (1 + 2 * _OVERLAP) / (_KNOTS - 1)
    step_q20 = abs(slope @ position) / np.ptp(part) * knot_um * ONE_Q20
    position *= min(1.0, _PRODUCT_MAX / (step_q20 * knot_um))
    return _weights_q13(position, 0), _weights_q13(force, ONE_Q13)


def _fit_weights(curve: Curves, noise: Noise) -> np.ndarray:
    # Light of two places adds up to more than any one place gives, in second order by slope**2:
    # the generalised least squares estimate of that part, blind to brightness and position.
    slope = curve.logs(curve.x_um[1]) - curve.logs(curve.x_um[0])
    design = np.stack([np.ones_like(slope), slope, slope**2], axis=1)
    information = 1 / noise.log_variance(2.0 ** curve.logs(_middle(curve)))
    weighted = design * information[:, None]
    weights = np.linalg.solve(design.T @ weighted, weighted.T)[2]
    return _weights_q13(2 * weights / np.abs(weights).sum(), 0)


def _knots(curve: Curves, part, position, force, test, firm: float) -> list[str]:
    reach = _OVERLAP * np.ptp(part)
    x = np.linspace(part[0] - reach, part[1] + reach, _KNOTS).clip(*curve.x_um)
    x = np.unique(x)
    x = np.linspace(x[0], x[-1], _KNOTS)
    logs = curve.logs(x)
    contrast, fits = logs @ position * _Q13_TO_Q20, logs @ test * (2**12 / ONE_Q13)
    offset = logs @ force * _Q13_TO_Q20 - firm
    order = np.argsort(contrast)
    if not (np.diff(x[order]) > 0).all() and not (np.diff(x[order]) < 0).all():
        raise SpotsError(
            f"the response is not monotone near {np.mean(part) / 1000:.0f} mm: check the order of "
            "the presses, and that the dye suits the length"
        )
    rows = np.stack([contrast, x, fits, offset], axis=1)[order]
    return [_statement("x", row) for row in rows]


def _force_table(rest, parts, pressed: Presses, firm: float) -> tuple[np.ndarray, np.ndarray]:
    """Return forces and brightnesses of the knots, from the lowest force that gave light."""
    lit = pressed.lit_everywhere()
    brightness = np.array(
        [
            (log - rest.logs(x)) @ _part_at(rest, parts, x)[1] * _Q13_TO_Q20 + firm
            for x, log in zip(lit.position_um, lit.logs)
        ]
    )
    forces = np.unique(lit.force_mN)
    means = np.array([brightness[lit.force_mN == f].mean() for f in forces])
    if len(forces) < FORCES_MIN or (np.diff(means) <= 0).any():
        raise SpotsError("the light does not grow with the force: check strip, LED and saturation")
    return _force_knots(forces, means)


def _force_knots(forces: np.ndarray, brightness: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    # Even in the logarithm of the force, for the bend at the top, and even in brightness, for the
    # steep foot: there the force in mN hardly changes while the light doubles.
    fine = np.geomspace(forces[0], forces[-1], 4000)
    curve = monotone(np.log(forces), brightness, np.log(fine))
    even = np.linspace(curve[0], curve[-1], _FORCE_KNOTS // 2)
    steps = np.geomspace(forces[0], forces[-1], _FORCE_KNOTS // 2)
    wanted = np.concatenate([np.interp(even, curve, fine), steps])
    knots = np.unique(np.round(wanted)).clip(forces[0], forces[-1])
    values = np.round(monotone(np.log(forces), brightness, np.log(knots)))
    rising = np.diff(values, prepend=-np.inf) > 0
    return knots[rising], values[rising]


def _position_sigma_um(rest: Curves, parts, noise: Noise, x_um: float, logs: np.ndarray) -> float:
    position, _ = _part_at(rest, parts, x_um)
    variance = noise.log_variance(2.0**logs)
    return float(np.sqrt(variance @ position**2) / abs(rest.slopes(x_um) @ position))


def _touch_force_mN(rest, parts, noise, forces, brightnesses, firm) -> int:
    places = np.linspace(*rest.x_um, 21)
    for force, brightness in zip(forces, brightnesses):
        dimmer = (brightness - firm) / ONE_Q20
        sigmas = [_position_sigma_um(rest, parts, noise, x, rest.logs(x) + dimmer) for x in places]
        if max(sigmas) <= _TOUCH_SIGMA_UM:
            return round(float(force))
    raise SpotsError(
        "the position is too noisy at every force: raise exposure, gain or LED current"
    )


def _tolerances(along: Presses, rest: Curves, noise, test, brightnesses, firm) -> list[float]:
    # At each force: how far a single press was off at worst, and noise, which falls as light grows.
    off = np.abs((along.logs - rest.logs(along.position_um)) @ test).max() / ONE_Q13
    logs = rest.logs(np.linspace(*rest.x_um, 21))
    tolerances = []
    for brightness in brightnesses:
        counts = 2.0 ** (logs + (brightness - firm) / ONE_Q20)
        sigma = np.sqrt(noise.log_variance(counts) @ test.astype(float) ** 2).max() / ONE_Q13
        tolerance = 1 + (off + _MISFIT_SIGMAS * sigma) * 2**12
        tolerances.append(min(max(tolerance, _TOLERANCE_MIN), _TOLERANCE_MAX))
    return tolerances
