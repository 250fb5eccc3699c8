"""A calibration's tables, shifted to what the channels have become at known places.

Drift changes each channel's log2 by c_i(x), a polynomial through the shifts at the marks. Every sum
that the board takes of the logs then changes by the same sum of c_i: contrasts, misfits, offsets of
the brightness, and the coarse contrast at the borders of segments. Weights stay.
"""

from __future__ import annotations

import numpy as np
from numpy.polynomial import polynomial

from spots_device.calibration import ONE_Q13, Calibration, CalibrationError
from spots_device.log2 import ONE as ONE_Q20
from spots_device.smux import CHANNELS

from ..errors import SpotsError

_ONE_Q12 = 1 << 12


def shifted(lines, place_um, shifts) -> list[str]:
    """Return the lines of a calibration whose channels have shifted.

    Parameters
    ----------
    lines : sequence of str
        As calibrated, see `spots_device.calibration`. Strained tables shift by the same c_i(x).
    place_um : sequence of float, length n
        Marks; n of them give a polynomial of degree n - 1.
    shifts : array_like, shape (n, 6)
        log2 of each channel now, less that at the calibration.

    Returns
    -------
    list of str

    Raises
    ------
    SpotsError
        If the tables do not stand that much drift.
    """
    curve = polynomial.polyfit(place_um, np.asarray(shifts), len(place_um) - 1)

    def change(weights, x_um: float, one: int = ONE_Q20) -> int:
        return round(float(polynomial.polyval(x_um, curve) @ weights) / ONE_Q13 * one)

    rows = [_integers(line) for line in lines]
    weights = {name: values for name, values in rows if name in ("coarse", "fit")}
    parts = [(w[:CHANNELS], w[CHANNELS:]) for name, w in rows if name == "segment"]
    borders = iter(_borders(rows, len(parts)))
    part = -1
    for name, values in rows:
        if name == "strain":
            part = -1
        elif name == "from":
            part += 1
            values[0] += change(weights["coarse"], next(borders))
        elif name == "x":
            position, force = parts[part]
            x_um = values[1]
            values[0] += change(position, x_um)
            values[2] += change(weights["fit"], x_um, _ONE_Q12)
            values[3] += change(force, x_um)
    found = [" ".join(map(str, (name, *values))) for name, values in rows]
    try:
        Calibration(found)
    except CalibrationError as error:
        raise SpotsError(
            f"the strip has changed more than its calibration allows ({error}): calibrate it again"
        ) from None
    return found


def _integers(line: str) -> tuple[str, list]:
    name, *values = line.split()
    return name, values if name in ("board", "plan") else [int(value) for value in values]


def _borders(rows, segments: int):
    """Yield where each segment begins, strain by strain; the tables overlap, the ends do not."""
    places: list[list[int]] = []
    for name, values in rows:
        if name == "strain":
            places.append([])
        elif name == "x":
            places[-1].append(values[1])
    for along in places:
        yield from np.linspace(min(along), max(along), segments + 1)[:-1].tolist()
