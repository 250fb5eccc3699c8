"""Fits the board's compensation of hysteresis and creep to a recording of known forces.

The compensated force is a gain times the force that the board reads without compensation, minus
hysteresis and creep. Hysteresis is a weighted sum of play operators (a model of backlash), whose
input is the force that the board reads. Creep is a sum of low-pass filters of the true force, each
times its share. The compensated force is linear in the gain, the weights and the shares, which are
fitted. See `spots_device.reading.silicone`.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from spots_device.reading.calibration import Calibration

from ...errors import CalibrationError
from .decoded import Decoded
from .fit import ONE_Q12
from .points import Point

PLAYS_MN = (300, 1000, 3000)  # half widths of the play operators
TAUS_MS = (400, 4000, 40_000)  # time constants of the creep
_LEAST_MN = 300.0  # weaker forces are not used: they are in the dead zone, or near it
_READINGS_MIN = 100  # least number of readings during presses
# Expected sizes of the weights of the play operators, and of the shares of creep. The fit tries all
# pairs of sizes, and uses the first pair with the largest evidence (marginal likelihood). The size
# is 0 if the recording does not show the effect.
_SIZES = (0.1, 0.03, 0.01, 0.0)
_NOISE_MN = 20.0  # standard deviation of the mean force error in one second: gauge and model
_CREEP_MS = 60_000  # creep is reported for a hold of this duration
_FULL_MN = 10_000.0  # hysteresis is reported as a percentage of this force
_SURE = 3.0  # least ratio of an effect to its standard deviation
_OFF_MAX = 0.2  # largest mean error of the compensated forces in a session, as a share
_SHARE_MIN = 0.005  # relative error of the force table, even if the forces are exact


class Compensated(NamedTuple):
    """Result of a fit: the compensation, and the hysteresis and creep of the strip.

    - `line`: line ``silicone`` to add to the lines of a calibration; empty if the recording shows
      neither hysteresis nor creep.
    - `sigma`: standard deviations of the gain, 3 weights of play operators and 3 shares of creep,
      times 2**12 like these values in `line`.
    - `before_mN`, `after_mN`: mean absolute error of the forces that the board reads, without and
      with compensation.
    - `hysteresis_percent`, `creep_percent`: value and standard deviation. Hysteresis is the largest
      difference between the forces that are read during unloading from 10 N and during loading,
      divided by 10 N. Creep is the growth of the measured force in 60 s, while the true force is
      constant. No silicone has a negative value: if one is significant, `line` is empty. Other
      negative values are not compensated.
    """

    line: str
    sigma: np.ndarray
    before_mN: float
    after_mN: float
    hysteresis_percent: tuple[float, float]
    creep_percent: tuple[float, float]

    @property
    def impossible(self) -> bool:
        """Whether an effect is significant, and has a sign that no silicone has."""
        return any(map(_is_impossible, (self.hysteresis_percent, self.creep_percent)))

    def __str__(self) -> str:
        effects = (
            "silicone: hysteresis {:.1f} ± {:.1f} % of 10 N, creep {:.1f} ± {:.1f} % in 60 s; "
        )
        effects = effects.format(*self.hysteresis_percent, *self.creep_percent)
        if self.impossible:
            return effects + (
                "no silicone has a negative value, so the board compensates neither: press the "
                "strip everywhere with 10 N (1 kg) several times, then begin another session"
            )
        return effects + "the board compensates both"


def _is_impossible(effect: tuple[float, float]) -> bool:
    value, sigma = effect
    return value < -_SURE * sigma


def fit_session(points: list[Point], lines: list[str], force_share: float) -> Compensated | None:
    """Fit the compensation of hysteresis and creep to the presses that a person made in a session.

    `lines` are a calibration without the line ``silicone``; `force_share` is the relative standard
    deviation of the forces that the person read off a scale. The compensation has an empty line if
    an effect is impossible; it is None if no press has two forces, or if the presses show neither
    hysteresis nor creep. CalibrationError if the presses have too few readings, or if the
    compensated forces are far from those that the person read.
    """
    if not any(len(p.holds) > 1 for p in points):
        return None
    decode = Decoded()
    decode.calibration = Calibration(lines)
    rows = []
    for i, p in enumerate(points):
        for time_s, *counts in p.trace:
            force_mN = np.nan
            for (begin_s, end_s), held_mN in zip(p.holds, (p.force_mN, p.then_mN)):
                if begin_s <= time_s <= end_s:
                    force_mN = held_mN
            decode.update_mean(counts)
            rows.append((time_s, force_mN, decode.force_mN, i))
    recorded = np.array(rows).T
    found = fit_silicone(*recorded, force_share=max(force_share, _SHARE_MIN))
    off = found.after_mN / np.nanmean(recorded[1])
    if off > _OFF_MAX:
        raise CalibrationError(
            f"the forces of the presses with two forces differ from the compensated ones by "
            f"{off:.0%} instead of at most {_OFF_MAX:.0%}, and nothing was stored: check the "
            "second force of these presses (then_mN in the session file), remove the line of a "
            "wrong one to repeat it, or begin another session with --session"
        )
    return found if found.line or found.impossible else None


def fit_silicone(time_s, force_mN, read_mN, place, force_share: float = 0.0) -> Compensated:
    """Fit the compensation of hysteresis and creep to a recording.

    The recording should have a hold of half a minute. It should also have presses at other places
    with different maximum forces, released in steps or slowly. Otherwise, the fit mistakes creep
    that is left from earlier presses for hysteresis.

    Parameters
    ----------
    time_s : array_like, shape (n,)
        Ascending times of the readings in s.
    force_mN : array_like, shape (n,)
        True forces in mN; 0 while nothing presses, NaN where unknown.
    read_mN : array_like, shape (n,)
        Forces that the board read without compensation, in mN.
    place : array_like, shape (n,)
        Place of the press in any unit. The fit assumes that a new place has no creep of earlier
        presses, so places must be at least 8 mm apart, or be pressed after a rest.
    force_share : float
        Relative standard deviation of forces that a person read off a scale; 0 for the forces of a
        gauge. Successive readings with the same force have the same error.

    Returns
    -------
    Compensated
        The compensation, and the effects that it compensates.

    Raises
    ------
    CalibrationError
        If the recording has fewer than 100 readings with forces above 0.3 N.
    """
    time_s, force_mN, read_mN = (np.asarray(a, float) for a in (time_s, force_mN, read_mN))
    place = np.asarray(place)
    pressed = (force_mN > _LEAST_MN) & (read_mN > _LEAST_MN)
    if pressed.sum() < _READINGS_MIN:
        raise CalibrationError(
            f"{pressed.sum()} readings during presses are too few for hysteresis and creep: load, "
            f"hold and unload the strip again, for at least {_READINGS_MIN} readings"
        )
    known_mN = np.where(np.isfinite(force_mN), force_mN, read_mN)
    columns = _columns(time_s, known_mN, read_mN, place)[pressed]
    terms = columns.shape[1]
    if force_share:
        new = (np.diff(known_mN, prepend=-1) != 0) | (np.diff(place, prepend=place[0]) != 0)
        _, hold = np.unique(np.cumsum(new)[pressed], return_inverse=True)
        errors = np.eye(hold.max() + 1)[hold] * force_share * force_mN[pressed, None]
        columns = np.hstack([columns, errors])
    off = force_mN[pressed] - read_mN[pressed]
    # Successive errors are correlated: each second of the recording counts as one measurement.
    noise_mN = _NOISE_MN * max(1 / float(np.median(np.diff(time_s))), 1.0) ** 0.5
    information, values = columns.T @ columns / noise_mN**2, columns.T @ off / noise_mN**2
    effects = np.zeros((2, terms))
    effects[0, 1 : 1 + len(PLAYS_MN)] = 2 * np.array(PLAYS_MN) / _FULL_MN
    effects[1, 1 + len(PLAYS_MN) :] = -np.expm1(-_CREEP_MS / np.array(TAUS_MS))
    pairs = [(plays, creep) for plays in _SIZES for creep in _SIZES]
    expected = max(
        pairs, key=lambda pair: _evidence(_prior(*pair, columns.shape[1]), information, values)
    )
    while True:
        prior = _prior(*expected, columns.shape[1])
        spread = np.linalg.inv(np.eye(len(prior)) + information * np.outer(prior, prior))
        spread *= np.outer(prior, prior)
        change = spread @ values
        after = off - columns @ change
        spread = spread[:terms, :terms] * max(float(np.mean(after**2)) / noise_mN**2, 1.0)
        found = change[:terms]
        sizes = [(100 * float(e @ found), 100 * float(np.sqrt(e @ spread @ e))) for e in effects]
        impossible = any(map(_is_impossible, sizes))
        if impossible or all(value >= 0 for value, _ in sizes):
            break
        # An effect that is negative by chance is not compensated.
        expected = tuple(size if value >= 0 else 0.0 for size, (value, _) in zip(expected, sizes))
    gain, *rest = np.round((np.eye(terms)[0] + found) * ONE_Q12).astype(int).tolist()
    weights, shares = rest[: len(PLAYS_MN)], rest[len(PLAYS_MN) :]
    numbers = gain, *PLAYS_MN, *weights, *TAUS_MS, *shares
    sure = any(value > _SURE * sigma for value, sigma in sizes) and not impossible
    return Compensated(
        " ".join(map(str, ("silicone", *numbers))) if sure else "",
        np.sqrt(np.diag(spread)) * ONE_Q12,
        float(np.abs(off).mean()),
        float(np.abs(off - columns[:, :terms] @ found).mean()),
        *sizes,
    )


def _prior(plays: float, creep: float, terms: int) -> np.ndarray:
    """Return the expected size of each unknown of the fit, in the order of the fit.

    The unknowns are: the gain minus 1; the weights of the play operators, with the size `plays`;
    the shares of the creep, with the size `creep`; and the errors of the forces, divided by their
    standard deviation. `terms` is the number of all unknowns.
    """
    sizes = [max(plays, creep), *[plays] * len(PLAYS_MN), *[creep] * len(TAUS_MS)]
    return np.array(sizes + [1.0] * (terms - len(sizes)))


def _evidence(prior: np.ndarray, information: np.ndarray, values: np.ndarray) -> float:
    """Return the natural logarithm of the probability of a recording, plus a constant.

    `prior`, shape (p,), has the expected sizes of the p unknowns. `information`, shape (p, p), and
    `values`, shape (p,), are the normal equations of the least-squares fit.
    """
    total = np.eye(len(prior)) + information * np.outer(prior, prior)
    scaled = prior * values
    return float(scaled @ np.linalg.solve(total, scaled) - np.linalg.slogdet(total)[1]) / 2


def _columns(time_s, force_mN, read_mN, place) -> np.ndarray:
    """Return the columns of the least-squares fit for each reading, shape (n, 7).

    The arguments are those of `fit_silicone`. The first column is the force that the board read.
    Three columns are for hysteresis: the value that a play operator would have if the force had
    only risen, minus its actual value. Three columns are for creep: the negative output of a
    low-pass filter of the true force.
    """
    radii, taus_s = np.array(PLAYS_MN, float), np.array(TAUS_MS) / 1000
    plays, crept = np.zeros(len(radii)), np.zeros(len(taus_s))
    rows = np.zeros((len(time_s), 1 + len(radii) + len(taus_s)))
    steps_s = np.diff(time_s, prepend=time_s[0]).clip(0)
    before_mN, fresh = 0.0, np.diff(place, prepend=place[0]) != 0
    for row, step_s, force, read, new in zip(rows, steps_s, force_mN, read_mN, fresh):
        if new:
            plays[:], crept[:], before_mN = 0.0, 0.0, 0.0
        crept += (before_mN - crept) * -np.expm1(-step_s / taus_s)
        loading = np.maximum(read - radii, 0)
        plays = plays.clip(loading, read + radii) if read > 0 else np.zeros(len(radii))
        row[:] = read, *(loading - plays), *-crept
        before_mN = force
    return rows
