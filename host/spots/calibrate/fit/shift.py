"""Shifts the tables of a calibration by the drift of the channels at known positions.

Drift adds c_i(x) to log2 of the counts of channel i at the position x. c_i goes through the drift
that was measured at the known positions, called marks: a quadratic through up to three marks. With
more, it is the quadratic that fits best, plus straight lines between its residuals. The tables
contain weighted sums of log2 of the counts: contrasts (which show the position), expected misfits,
corrections of the brightness, and the coarse contrast at which each segment begins, see
`reading.calibration_lines`. A sum with the weights w_i changes by the sum of w_i c_i(x). The
weights do not change.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np
from numpy.polynomial import polynomial
from numpy.typing import ArrayLike

from spots_device.reading.calibration import Calibration
from spots_device.reading.calibration_lines import ONE_Q13
from spots_device.reading.calibration_lines import CalibrationError as LinesError
from spots_device.reading.log2 import ONE as ONE_Q20
from spots_device.sensor.smux import CHANNELS

from ...common import press_spectra
from ...errors import CalibrationError
from .fit import ONE_Q12

_DEGREE = 2  # of the drift of LED, filters, and a dye that changes everywhere alike


def drift_at(x_um: float, place_um: Sequence[float], shifts: ArrayLike) -> np.ndarray:
    """Return the drift of log2 of each channel at a position, from that at the marks."""
    return _curve(place_um, shifts)(x_um)


def shifted(lines: Sequence[str], place_um: Sequence[float], shifts: ArrayLike) -> list[str]:
    """Return the lines of a calibration after a drift of its channels.

    The tables of all strains shift by the same c_i(x), see the module docstring. `shifts`, shape
    (n, 6) for n marks, is log2 of the present counts minus log2 of the counts at the calibration.
    CalibrationError if the drift is too large for the tables.
    """
    curve = _curve(place_um, shifts)

    def change(weights, x_um: float, one: int = ONE_Q20) -> int:
        return round(float(curve(x_um) @ weights) / ONE_Q13 * one)

    rows = [_integers(line) for line in lines]
    weights = {name: values for name, values in rows if name in ("coarse", "fit")}
    segments = [values for name, values in rows if name == "segment"]
    for name, values in rows:
        if name == "spectrum":
            press_spectra.shifted(values, curve(values[0]))
    begins = [i for i, (name, _) in enumerate(rows) if name == "strain"]
    for begin, end in zip(begins, [*begins[1:], len(rows)]):
        places = [values[1] for name, values in rows[begin:end] if name == "x"]
        # Segments are equal parts of the strip.
        borders = np.linspace(min(places), max(places), len(segments) + 1)
        parts = zip(borders.tolist(), segments)
        for name, values in rows[begin:end]:
            if name == "from":
                border_um, segment = next(parts)
                values[0] += change(weights["coarse"], border_um)
            elif name == "x":
                x_um = values[1]
                values[0] += change(segment[:CHANNELS], x_um)
                values[2] += change(weights["fit"], x_um, ONE_Q12)
                values[3] += change(segment[CHANNELS:], x_um)
    found = [" ".join(map(str, (name, *values))) for name, values in rows]
    try:
        Calibration(found)
    except LinesError as error:
        raise CalibrationError(
            f"the strip has changed more than a re-zero can correct ({error}): calibrate it again"
        ) from None
    return found


def _curve(place_um, shifts) -> Callable[[float], np.ndarray]:
    places, shifts = np.asarray(place_um, float), np.asarray(shifts, float)
    smooth = polynomial.polyfit(places, shifts, min(len(places) - 1, _DEGREE))
    rest = shifts.T - polynomial.polyval(places, smooth)

    def at(x_um: float) -> np.ndarray:
        local = [np.interp(x_um, places, one) for one in rest]
        return polynomial.polyval(x_um, smooth) + local

    return at


def _integers(line: str) -> tuple[str, list]:
    name, *values = line.split()
    return name, values if name in ("board", "plan", "presser") else [
        int(value) for value in values
    ]
