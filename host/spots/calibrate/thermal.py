"""Lines of a calibration with which a board follows its temperature, from several re-zeros.

Between two re-zeros on one day, LED, filters and strip change with the temperature. Slow changes,
such as bleaching, are small in a day. So the difference of the two gives the change per kelvin, and
the last re-zero gives the present state. `spots_device.reading.thermal` uses the lines.
"""

from __future__ import annotations

from collections.abc import Sequence
from datetime import timedelta

import numpy as np
from numpy.polynomial import polynomial

from spots_device.reading.calibration import Calibration
from spots_device.reading.calibration_lines import CalibrationError
from spots_device.reading.log2 import ONE as ONE_Q20

from . import calibration_file as file

_PAUSE = timedelta(days=1)  # longest time between two re-zeros whose difference is used
_LEAST_K = 3.0  # a smaller difference of the temperature gives too much noise
_MARKS_MAX = 3  # lines ``warm`` of a board
_SAME = 1e-5  # log2: a smaller mean of all channels means that the force was unknown


def with_lines(lines: Sequence[str], rezeros: Sequence[file.Rezero]) -> list[str]:
    """Return the lines of a calibration, with ``temperature`` and ``warm`` if they are known.

    The re-zeros, all with one presser, begin with the oldest; the tables of the calibration are
    those of the last one. The result is only `lines` if the last re-zero has no temperature, if no
    re-zeros at the same marks, within a day, were at temperatures 3 K apart, or if the change does
    not fit the tables.
    """
    found = [*lines, *_lines(rezeros)]
    try:
        Calibration(found)
    except CalibrationError:
        return list(lines)
    return found


def _lines(rezeros: Sequence[file.Rezero]) -> list[str]:
    last = rezeros[-1]
    if last.temperature_C is None:
        return []
    marks_um = None
    steps, seen = [], [last.temperature_C]
    for before, after in zip(reversed(rezeros[:-1]), reversed(rezeros[1:])):
        if before.temperature_C is None or after.temperature_C is None:
            continue
        if after.date - before.date > _PAUSE or before.place_um != after.place_um:
            continue
        if after.place_um != (marks_um or after.place_um):
            continue
        marks_um = after.place_um
        steps.append((after.temperature_C - before.temperature_C, _difference(before, after)))
        seen += [before.temperature_C, after.temperature_C]
    if marks_um is None:
        return []
    kelvins = np.array([kelvin for kelvin, _ in steps])
    if np.hypot.reduce(kelvins) < _LEAST_K:
        return []
    # Least squares: larger steps have more weight.
    per_K = np.tensordot(kelvins, [step for _, step in steps], 1) / (kelvins @ kelvins)
    if len(marks_um) > _MARKS_MAX:  # the temperature changes the whole strip alike
        smooth = polynomial.polyfit(marks_um, per_K, _MARKS_MAX - 1)
        marks_um = marks_um[0], marks_um[len(marks_um) // 2], marks_um[-1]
        per_K = polynomial.polyval(marks_um, smooth).T
    changes = np.rint(per_K * (max(seen) - min(seen)) * ONE_Q20).astype(int).tolist()
    range_mC = [round(1000 * celsius) for celsius in (last.temperature_C, min(seen), max(seen))]
    found = [["temperature", *range_mC]]
    found += [["warm", round(x_um), *change] for x_um, change in zip(marks_um, changes)]
    return [" ".join(map(str, line)) for line in found]


def _difference(before: file.Rezero, after: file.Rezero) -> np.ndarray:
    """Return how log2 of the counts changed, shape (n, 6): rows are marks, columns are channels."""
    shifts = np.array([before.shifts, after.shifts])
    difference = shifts[1] - shifts[0]
    if (np.abs(shifts.mean(axis=2)).max(axis=1) < _SAME).any():
        difference -= difference.mean(axis=1, keepdims=True)
    return difference
