"""Fits a calibration to presses at known positions and with known forces.

L_i is log2 of the dark-subtracted counts of channel i. By Eq. 1 of the paper, L_i
is locally linear in the position and in the logarithm of the coupled light. Generalised least
squares with the noise of each channel gives the best linear estimates of these two quantities. In
each segment of the strip, the estimate of each quantity is a weighted sum of the L_i. The misfit is
one more weighted sum: it shows how far a spectrum is from that of one press. Qn is the number
format of the board: an integer that is the value times 2**n.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from spots_device.reading.calibration import Conditions
from spots_device.reading.calibration_lines import ONE_Q13, WEIGHT_SUM_MAX
from spots_device.reading.log2 import ONE as ONE_Q20

from ...common import press_spectra
from ...errors import CalibrationError
from .cross import Change, change
from .curves import Curves
from .monotone import monotone
from .presses import Noise, Presses

SEGMENTS = 5  # equal parts of the strip, each with its own weights and table
_KNOTS = 9  # in the table of a segment
_OVERLAP = 0.25  # share of a segment by which its table reaches into the next segments
_FORCE_KNOTS = 72  # in the table from brightness to force
_FORCE_STEPS = 4000  # points of the curve to which these knots are fitted
_FORCE_SUM_MAX = 0.99 * WEIGHT_SUM_MAX / ONE_Q13  # limit of the sum of the weights' absolute values
# Longer calibrations have no lines for the host: a board has no memory for them beside six strains.
_LINES_MAX = 360
PLACES_MIN = 12  # least number of positions of a calibration
FORCES_MIN = 10  # least number of forces of a calibration
_NOISE_PLACES = 21  # number of positions at which the noise is computed
# A touch begins at the least force at which the standard deviation of the position is below a limit
# everywhere. The limit is 500 um, or 1/36 of the strip's length if that is more. With 1/36 of the
# length, each of ten keys in a row is 3.6 standard deviations wide.
_TOUCH_SIGMA_UM, _TOUCH_SIGMA_SHARE = 500.0, 1 / 36
_TOUCH_ABOVE_DARK = 1.15  # a touch begins at least at this multiple of the dead zone
_TOUCH_HYSTERESIS = 0.7  # least force at which a touch ends, as a share of that at which it begins
_MISFIT_SIGMAS = 6.0  # part of the tolerance of the misfit that is due to noise
_PRODUCT_MAX = 2.0**28  # a quarter of the limit of 31 bits; the margin is for bends and strain
# Limits of the tolerance of the misfit, Q12. The lower limit tolerates an LED that cools by 1 or
# 2 K in a dark frame, which shifts positions by 10 um on 85 mm. Light that needs more than the
# upper limit is too dim to show a second press.
_TOLERANCE_MIN = 12
_TOLERANCE_MAX = 600
_CROSS_UM = 20.0  # least correction for the cross-sensitivity, in um
_NEWTON = 4  # iterations that find the position of a contrast
_Q13_TO_Q20 = ONE_Q20 / ONE_Q13
ONE_Q12 = 1 << 12  # the number 1 in Q12


def fit(
    along: dict[int, Presses],
    pressed: Presses,
    noise: Noise,
    conditions: Conditions,
    misfit: np.ndarray | None = None,
) -> list[str]:
    """Fit a calibration and return its lines, see `spots_device.reading.calibration_lines`.

    `along` has presses with one firm force along the whole strip by the strain in ppm; strain 0 is
    required. Positions are measured on the stretched strip. No channel is dark or saturated.
    `pressed` are presses with different forces at a few positions of the strip at rest; the forces
    are the same at all positions. `misfit`, shape (n, 6), is measured minus expected log2 of the
    counts of n presses; without it, the presses in ``along[0]`` are compared with smooth curves
    through them. The larger these errors, the larger the misfit that the board tolerates.

    With more than five strains, the spectra of the presses are left out. CalibrationError if the
    readings are too noisy or too dark, or do not change monotonically with position or force.
    """
    curves = {strain: Curves.of(p, noise) for strain, p in sorted(along.items())}
    relaxed = curves[0]
    coarse, _ = _weights(relaxed, noise, relaxed.ends_um, has_table=False)
    test = _fit_weights(relaxed, noise)
    parts = [_weights(relaxed, noise, part) for part in _parts(relaxed)]
    middle_um = float(np.mean(relaxed.ends_um))
    firm = relaxed.logs(middle_um) @ _part_at(relaxed, parts, middle_um)[1] * _Q13_TO_Q20
    forces, brightnesses = _force_table(relaxed, parts, pressed, firm)
    lines = [
        "board " + conditions.board,
        "plan " + " ".join(conditions.plan),
        f"made {conditions.gain} {conditions.exposure_us} {conditions.led_mA}",
        _statement("coarse", coarse),
        _statement("fit", test),
        *(_statement("segment", [*position, *force]) for position, force in parts),
        *press_spectra.statements(relaxed.ends_um, relaxed.logs),
    ]
    dimmer = (brightnesses - firm) / ONE_Q20
    sigma_um, sigma_misfit = _sigmas(relaxed, parts, test, noise, dimmer)
    limit_um = max(_TOUCH_SIGMA_UM, _TOUCH_SIGMA_SHARE * np.ptp(relaxed.ends_um))
    if sigma_um.min() > limit_um:
        raise CalibrationError(
            "the position is too noisy at every force: raise exposure, gain or LED current"
        )
    begin = max(forces[np.argmax(sigma_um <= limit_um)], _TOUCH_ABOVE_DARK * forces[0])
    # A touch ends at least halfway between the force at which it begins and the dead zone
    # (`forces[0]`), so that weak ambient light does not prolong a touch.
    end = max(_TOUCH_HYSTERESIS * begin, (forces[0] + begin) / 2)
    lines.append(_statement("touch", (begin, end)))
    # The largest misfit of a single press is added to the noise.
    if misfit is None:
        misfit = along[0].logs - relaxed.logs(along[0].position_um)
    off = np.abs(misfit @ test).max() / ONE_Q13
    tolerances = 1 + (off + _MISFIT_SIGMAS * sigma_misfit) * ONE_Q12
    tolerances = tolerances.clip(_TOLERANCE_MIN, _TOLERANCE_MAX)
    sure = forces >= end
    cross = _cross(relaxed, parts, test, pressed, noise, dimmer, sure, sigma_um, sigma_misfit)
    shares = [np.round(cross.shares * ONE_Q12)] if cross else []
    if cross:
        tint = cross.change
        lines += press_spectra.tint_statements(tint.ends_um, tint.lights, tint.logs)
    lines += [_statement("f", knot) for knot in zip(brightnesses, forces, tolerances, *shares)]
    for strain, curve in curves.items():
        lines.append(f"strain {strain}")
        for (position, force), part in zip(parts, _parts(curve)):
            lines.append(f"from {round(float(curve.logs(part[0]) @ coarse) * _Q13_TO_Q20)}")
            lines += _knots(curve, part, position, force, test, firm, cross)
    return lines if len(lines) <= _LINES_MAX else press_spectra.without(lines)


def _finite(values: np.ndarray) -> np.ndarray:
    if not np.isfinite(values).all():
        raise CalibrationError(
            "these presses give no calibration: check their positions and forces, or begin another "
            "session"
        )
    return values


def _statement(name: str, values) -> str:
    values = _finite(np.asarray(values, float))
    return " ".join([name, *(str(round(float(value))) for value in values)])


def _parts(curve: Curves) -> list[tuple[float, float]]:
    borders = np.linspace(*curve.ends_um, SEGMENTS + 1)
    return [*zip(borders, borders[1:])]


def _part_at(curve: Curves, parts, x_um: float):
    share = (x_um - curve.ends_um[0]) / np.ptp(curve.ends_um)
    return parts[min(max(int(share * SEGMENTS), 0), SEGMENTS - 1)]


def _weights_q13(weights: np.ndarray, total: int) -> np.ndarray:
    # The rounded weights must add up exactly: the largest one absorbs the sum of rounding errors.
    rounded = np.round(_finite(weights) * ONE_Q13).astype(int)
    rounded[np.argmax(np.abs(rounded))] += total - rounded.sum()
    return rounded


def _weights(
    curve: Curves, noise: Noise, part, has_table: bool = True
) -> tuple[np.ndarray, np.ndarray]:
    """Return the channel weights for the position and those for the force, in one segment.

    `part` is the pair of start and end of the segment, in um. `has_table` is whether the segment
    gets a table of knots.
    """
    information = 1 / noise.log_variance(2.0 ** curve.logs(np.mean(part)))
    # With the mean slope of the segment, the mean error of the force in the segment is 0.
    slope = curve.logs(part[1]) - curve.logs(part[0])
    design = np.stack([np.ones_like(slope), slope / np.abs(slope).max()], axis=1)
    force, position = estimators(design, information)
    position *= 2 / np.abs(position).sum()
    # If all channels decay nearly alike, weights that cancel the decay are large. Weights at the
    # board's limit cancel a part of the decay; the brightness correction of each knot cancels the
    # rest.
    brightest, size = information / information.sum(), np.abs(force).sum()
    if size > _FORCE_SUM_MAX:
        force = brightest + (force - brightest) * (_FORCE_SUM_MAX - 1) / (size - 1)
    # The board multiplies a step of the contrast by a step of the position. A smaller contrast
    # keeps the product within 31 bits; the contrast's resolution is still high enough.
    knot_um = np.ptp(part) * (1 + 2 * _OVERLAP) / (_KNOTS - 1)
    step_q20 = abs(slope @ position) / np.ptp(part) * knot_um * ONE_Q20
    position *= min(1.0, _PRODUCT_MAX / (step_q20 * knot_um))
    if has_table:
        # So it does with a step of the brightness correction, which is large where the dye's
        # decay changes fast along the strip.
        knots = curve.logs(_places(curve, part)) * ONE_Q20
        steps, offsets = (np.abs(np.diff(knots @ weights)) for weights in (position, force))
        position *= min(1.0, 2 * _PRODUCT_MAX / max((steps * offsets).max(), 1.0))
    return _weights_q13(position, 0), _weights_q13(force, ONE_Q13)


def _fit_weights(curve: Curves, noise: Noise) -> np.ndarray:
    # log2 of the counts of two simultaneous presses differs from that of one press by a term in
    # slope**2. The estimate of this term does not depend on brightness and position.
    slope = curve.logs(curve.ends_um[1]) - curve.logs(curve.ends_um[0])
    design = np.stack([np.ones_like(slope), slope, slope**2], axis=1)
    information = 1 / noise.log_variance(2.0 ** curve.logs(np.mean(curve.ends_um)))
    weights = estimators(design, information)[2]
    return _weights_q13(2 * weights / np.abs(weights).sum(), 0)


def estimators(design: np.ndarray, information: np.ndarray) -> np.ndarray:
    """Return generalised least-squares weights to estimate unknowns from log2 of the counts.

    `design`, shape (c, n), has the derivatives of log2 of the counts of c channels by n unknowns;
    `information` the reciprocal of the variance of each channel's log2. The weights have shape (n,
    c). CalibrationError if the channels cannot distinguish the unknowns.
    """
    weighted = design * information[:, None]
    try:
        return np.linalg.solve(design.T @ weighted, weighted.T)
    except np.linalg.LinAlgError:
        raise CalibrationError(
            "the light of all channels decays alike along the strip: choose other channels with "
            "--channels, or a dye or an LED of another colour"
        ) from None


def _sigmas(relaxed: Curves, parts, test, noise: Noise, dimmer) -> tuple[np.ndarray, np.ndarray]:
    """Return the largest standard deviations along the strip: position in um, misfit in log2 units.

    `relaxed` has log2 of the counts of firm presses along the strip at rest. `dimmer` contains n
    brightnesses relative to these presses, in log2 units; both results have shape (n,). `parts`
    contains the weights of each segment for position and force, and `test` the weights of the
    misfit.
    """
    places = np.linspace(*relaxed.ends_um, _NOISE_PLACES)
    variance = noise.log_variance(2.0 ** (relaxed.logs(places) + dimmer[:, None, None]))
    weights = np.array([_part_at(relaxed, parts, x)[0] for x in places])
    slopes = np.abs((relaxed.slopes(places) * weights).sum(axis=-1))
    if not slopes.all():
        raise _unsteady(places[np.argmin(slopes)])
    sigma_um = np.sqrt((variance * weights**2.0).sum(axis=-1)) / slopes
    sigma_misfit = np.sqrt(variance @ test**2.0) / ONE_Q13
    return sigma_um.max(axis=1), sigma_misfit.max(axis=1)


def _places(curve: Curves, part) -> np.ndarray:
    reach = _OVERLAP * np.ptp(part)
    return np.linspace(*np.clip([part[0] - reach, part[1] + reach], *curve.ends_um), _KNOTS)


def _unsteady(place_um: np.floating) -> CalibrationError:
    return CalibrationError(
        f"the colour near {place_um / 1000:.0f} mm does not change steadily along the strip: check "
        "the positions of the presses there, and that the dye suits the strip's length"
    )


def _knots(
    curve: Curves, part, position, force, test, firm: float, cross: _Cross | None
) -> list[str]:
    x = _places(curve, part)
    logs = curve.logs(x)
    contrast, fits = logs @ position * _Q13_TO_Q20, logs @ test * (ONE_Q12 / ONE_Q13)
    offset = logs @ force * _Q13_TO_Q20 - firm
    order = np.argsort(contrast)
    if not (np.diff(x[order]) > 0).all() and not (np.diff(x[order]) < 0).all():
        raise _unsteady(np.mean(part))
    sizes = cross.sizes(curve, x, position, test) if cross else ()
    rows = np.stack([contrast, x, fits, offset, *sizes], axis=1)[order]
    return [_statement("x", row) for row in rows]


@dataclass(frozen=True)
class _Cross:
    """The cross-sensitivity as the board corrects it: products of a share and two sizes.

    `lights` are the brightness of the knots of the table of forces, in log2 units; that of a firm
    press is 0. `shares` and `weights` belong to these knots; the largest absolute share is 1.
    `ends_um` are those of the strip at rest.
    """

    change: Change
    lights: np.ndarray
    shares: np.ndarray
    weights: np.ndarray
    ends_um: np.ndarray

    def sizes(self, curve: Curves, x_um, position, test) -> list[np.ndarray]:
        """Return the sizes of the corrections of position (um) and expected misfit (Q12) at knots.

        `curve` has log2 of the counts along the strip at some strain. `position` contains the
        weights of the contrast, `test` those of the misfit.
        """
        weights = self.weights * self.shares
        weights = weights / (weights @ self.shares)
        off = _off(curve, self.change, self.ends_um, x_um, self.lights, position, test)
        return [errors @ weights for errors in off]


def _cross(
    relaxed: Curves,
    parts,
    test,
    pressed: Presses,
    noise: Noise,
    dimmer,
    sure,
    sigma_um,
    sigma_misfit,
) -> _Cross | None:
    """Return the correction for the cross-sensitivity, or None if it is not needed.

    `dimmer` and `sure` are the brightnesses of the table of forces, and whether a press with this
    brightness is a touch. `sigma_um` and `sigma_misfit` are the noise there. The other arguments
    are those of `_sigmas` and `_force_table`.
    """
    lit = pressed.lit_everywhere()
    off = lit.logs - relaxed.logs(lit.position_um)
    weights = np.array([_part_at(relaxed, parts, x)[1] for x in lit.position_um]) / ONE_Q13
    light = (off * weights).sum(axis=1)
    firm = light >= dimmer[sure][0]
    lit, off, light = lit.keep(firm), off[firm], light[firm]
    found = change(lit, off, light, relaxed.slopes(lit.position_um), noise, relaxed.ends_um)
    if found is None:
        return None
    # The corrections at all positions and forces are a matrix; its first singular vectors are the
    # best approximation by products. Below the weakest sure force, the share does not change.
    errors = [
        _off(relaxed, found, relaxed.ends_um, _places(relaxed, part), dimmer[sure], position, test)
        for (position, _), part in zip(parts, _parts(relaxed))
    ]
    errors_um, errors_q12 = (np.concatenate(column) for column in zip(*errors))
    scaled = np.concatenate(
        [errors_um / sigma_um[sure], errors_q12 / (sigma_misfit[sure] * ONE_Q12)]
    )
    _, _, forces = np.linalg.svd(scaled, full_matrices=False)
    shares = forces[0] * sigma_um[sure]
    shares /= np.abs(shares).max()
    shares = np.concatenate([np.full(len(sure) - sure.sum(), shares[0]), shares])
    cross = _Cross(found, dimmer, shares, np.where(sure, sigma_um**-2.0, 0.0), relaxed.ends_um)
    sizes_um = [
        cross.sizes(relaxed, _places(relaxed, part), position, test)[0]
        for (position, _), part in zip(parts, _parts(relaxed))
    ]
    # Weaker presses are too noisy for this decision.
    clear = sigma_um <= sigma_um[sure][0] / 2
    return cross if np.abs(sizes_um).max() * np.abs(shares[clear]).max() > _CROSS_UM else None


def _off(curve: Curves, change: Change, ends_um, x_um, lights, position, test):
    """Return how far positions (um) and misfits (Q12) are wrong without a correction, negated.

    The contrasts are those of firm presses at the n positions `x_um` on the strip of `curve`. Both
    results have the shape (n, m): m brightnesses `lights` would have these contrasts elsewhere.
    """
    stretch = curve.ends_um[1] / ends_um[1]
    firm = curve.logs(x_um)
    at_um = np.repeat(x_um[:, None], len(lights), axis=1)
    for _ in range(_NEWTON):
        inside_um = at_um.clip(*curve.ends_um)
        logs = curve.logs(inside_um) + change.logs(
            inside_um / stretch, np.broadcast_to(lights, at_um.shape)
        )
        slopes = curve.slopes(inside_um)
        logs += slopes * (at_um - inside_um)[:, :, None]
        at_um = at_um - ((logs - firm[:, None]) @ position) / (slopes @ position)
    return at_um - x_um[:, None], ((logs - firm[:, None]) @ test) * (ONE_Q12 / ONE_Q13)


def _force_table(relaxed, parts, pressed: Presses, firm: float) -> tuple[np.ndarray, np.ndarray]:
    """Return the table from brightness to force: ascending forces in mN, and brightnesses in Q20.

    `relaxed` has log2 of the counts of firm presses along the strip at rest, and `firm` is their
    brightness in Q20. `parts` contains the weights of each segment; `pressed` has the presses with
    different forces.
    """
    lit = pressed.lit_everywhere()
    brightness = np.array(
        [
            (log - relaxed.logs(x)) @ _part_at(relaxed, parts, x)[1] * _Q13_TO_Q20 + firm
            for x, log in zip(lit.position_um, lit.logs)
        ]
    )
    forces = np.unique(lit.force_mN)
    means = np.array([brightness[lit.force_mN == f].mean() for f in forces])
    if len(forces) < FORCES_MIN:
        raise CalibrationError(
            f"only {len(forces)} forces give light in all channels, but {FORCES_MIN} are needed: "
            "press with more different forces, or check the strip, its LED and the gain"
        )
    if (np.diff(means) <= 0).any():
        raise CalibrationError(
            "the brightness does not rise with the force: check the strip, its LED and the gain"
        )
    # The table is a least-squares spline of straight lines. Its errors have both signs; straight
    # lines between points of the curve would have errors of one sign. Half of the knots are evenly
    # spaced in brightness, for the start of a touch. The other knots are denser where the curve
    # bends more, so that the largest error is the same between all neighbouring knots.
    fine = np.geomspace(forces[0], forces[-1], _FORCE_STEPS)
    curve = monotone(np.log(forces), means, np.log(fine))
    even = np.linspace(curve[0], curve[-1], _FORCE_STEPS // 10)
    bend = np.sqrt(np.abs(np.gradient(np.gradient(np.interp(even, curve, fine)))))
    share = np.cumsum(1 + bend / bend.mean())
    values = np.interp(np.linspace(share[0], share[-1], _FORCE_KNOTS), share, even)
    hats = np.stack([np.interp(curve, values, one) for one in np.eye(_FORCE_KNOTS)], axis=1)
    knots = np.round(np.linalg.lstsq(hats, fine, rcond=None)[0])
    rising = np.diff(knots, prepend=-np.inf) > 0
    return knots[rising], np.round(values[rising])
