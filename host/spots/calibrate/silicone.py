"""Fits the board's compensation of hysteresis and creep to a recording of known forces.

The compensated force is the gain times the force that the board read without compensation, minus
play operators of that force times weights (hysteresis), minus low-pass filters of the true force
times shares (creep). The force is linear in the gain, the weights and the shares, which are fitted.
See `spots_device.silicone`.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from ..errors import SpotsError
from .fit import ONE_Q12

PLAYS_MN = (300, 1000, 3000)  # half widths
TAUS_MS = (400, 4000, 40_000)
_LEAST_MN = 300.0  # weaker forces are in the dead zone, or nearly
_READINGS_MIN = 300
_PRIOR = 0.1  # expected size of a weight
_NOISE_MN = 20.0  # standard deviation of recorded forces: errors of the scale and of the model


class Compensated(NamedTuple):
    """Fitted compensation.

    Attributes
    ----------
    line : str
        Line ``silicone`` to add to the lines of a calibration.
    sigma : numpy.ndarray, shape (7,)
        Standard deviations of the gain, 3 weights of plays and 3 shares of creep, as in `line`.
    before_mN, after_mN : float
        Mean absolute error of the recorded forces without and with compensation.
    """

    line: str
    sigma: np.ndarray
    before_mN: float
    after_mN: float


def fit_silicone(time_s, force_mN, read_mN, place) -> Compensated:
    """Fit the compensation of hysteresis and creep to a recording.

    The recording should have one press of a minute, then presses at other places with different
    speeds and maximum forces, and with pauses. The fit would otherwise mistake creep that is left
    from earlier presses for hysteresis.

    Parameters
    ----------
    time_s : array_like, shape (n,)
        Ascending times of the readings in s.
    force_mN : array_like, shape (n,)
        True forces in mN; 0 while nothing presses.
    read_mN : array_like, shape (n,)
        Forces that the board read without compensation, in mN.
    place : array_like, shape (n,)
        Place of the press in any unit. The fit assumes that a new place has no creep of earlier
        presses, so places must be at least 8 mm apart.

    Returns
    -------
    Compensated

    Raises
    ------
    SpotsError
        If the recording has too few readings of a press, or does not determine the weights.
    """
    time_s, force_mN, read_mN = (np.asarray(a, float) for a in (time_s, force_mN, read_mN))
    place = np.asarray(place)
    pressed = (force_mN > _LEAST_MN) & (read_mN > _LEAST_MN)
    if pressed.sum() < _READINGS_MIN:
        raise SpotsError(
            f"{pressed.sum()} readings of a press are too few for hysteresis and creep: load, hold "
            f"and unload the strip again, for at least {_READINGS_MIN} readings"
        )
    columns = _columns(time_s, force_mN, read_mN, place)[pressed]
    # A prior: a gain of 1 and other weights of 0, from which each deviates by about `_PRIOR`.
    unit = np.eye(columns.shape[1])
    off = force_mN[pressed] - read_mN[pressed]
    information = columns.T @ columns / _NOISE_MN**2 + unit / _PRIOR**2
    change = np.linalg.solve(information, columns.T @ off / _NOISE_MN**2)
    after = off - columns @ change
    # Successive errors are correlated: each second of the recording counts as one measurement.
    seconds = max(np.ptp(time_s[pressed]), 1.0)
    spread = np.linalg.inv(information) * np.mean(after**2) / _NOISE_MN**2
    sigma = np.sqrt(np.diag(spread) * max(pressed.sum() / seconds, 1.0))
    gain, *rest = np.round((unit[0] + change) * ONE_Q12).astype(int).tolist()
    plays, shares = rest[: len(PLAYS_MN)], rest[len(PLAYS_MN) :]
    values = gain, *PLAYS_MN, *plays, *TAUS_MS, *shares
    return Compensated(
        " ".join(map(str, ("silicone", *values))),
        sigma * ONE_Q12,
        float(np.abs(off).mean()),
        float(np.abs(after).mean()),
    )


def _columns(time_s, force_mN, read_mN, place) -> np.ndarray:
    """Return the terms of the force without their gain, weights and shares, shape (n, 7)."""
    radii, taus_s = np.array(PLAYS_MN, float), np.array(TAUS_MS) / 1000
    plays, crept = np.zeros(len(radii)), np.zeros(len(taus_s))
    rows = np.zeros((len(time_s), 1 + len(radii) + len(taus_s)))
    steps_s = np.diff(time_s, prepend=time_s[0])
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
