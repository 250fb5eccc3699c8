"""Shifts the tables of a calibration by the drift of the channels at known positions.

Drift adds c_i(x) to log2 of the counts of channel i at the position x. c_i is a polynomial through
the drift that was measured at the known positions, called marks. The tables contain weighted sums
of log2 of the counts: contrasts (which show the position), expected misfits, corrections of the
brightness, and the coarse contrast at which each segment begins, see `reading.calibration_lines`. A
sum with the weights w_i changes by the sum of w_i c_i(x). The weights do not change.
"""

from __future__ import annotations

from collections.abc import Sequence

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


def drift_at(x_um: float, place_um: Sequence[float], shifts: ArrayLike) -> np.ndarray:
    """Return the drift of log2 of each channel at a position, from that at the marks."""
    return polynomial.polyval(x_um, _curve(place_um, shifts))


def shifted(lines: Sequence[str], place_um: Sequence[float], shifts: ArrayLike) -> list[str]:
    """Return the lines of a calibration after a drift of its channels.

    The tables of all strains shift by the same c_i(x), see the module docstring: a polynomial of
    degree n - 1 in the position, for n marks. `shifts`, shape (n, 6), is log2 of the present counts
    minus log2 of the counts at the calibration. CalibrationError if the drift is too large for the
    tables.
    """
    curve = _curve(place_um, shifts)

    def change(weights, x_um: float, one: int = ONE_Q20) -> int:
        return round(float(polynomial.polyval(x_um, curve) @ weights) / ONE_Q13 * one)

    rows = [_integers(line) for line in lines]
    weights = {name: values for name, values in rows if name in ("coarse", "fit")}
    segments = [values for name, values in rows if name == "segment"]
    for name, values in rows:
        if name == "spectrum":
            press_spectra.shifted(values, polynomial.polyval(values[0], curve))
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


def _curve(place_um, shifts) -> np.ndarray:
    return polynomial.polyfit(place_um, np.asarray(shifts), len(place_um) - 1)


def _integers(line: str) -> tuple[str, list]:
    name, *values = line.split()
    return name, values if name in ("board", "plan") else [int(value) for value in values]
