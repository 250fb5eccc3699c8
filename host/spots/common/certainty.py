"""The standard deviation of a position due to noise, computed from a calibration.

The lines of a calibration contain the spectra of firm presses, so position and brightness of a
reading give the expected counts of its channels. The noise of a count has a constant part and a
part that grows with the count. The weights of the board's position contrast turn both into the
standard deviation of the position. Errors that do not change from reading to reading are not
included: those of the calibration, and drift.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from spots_device.reading.calibration import Calibration
from spots_device.reading.calibration_lines import ONE_Q13, CalibrationError
from spots_device.reading.decode import BOUNDS, SEGMENTS, columns_of
from spots_device.reading.log2 import ONE as ONE_Q20
from spots_device.sensor.smux import CHANNELS

from .press_spectra import press_spectra

# Variance of a count of one sample: read noise and rounding in counts**2, and shot noise by count.
_CONSTANT, _PER_COUNT = 0.102, 1.8e-5
# Rounding error of a mean, in counts**2: more samples of a steady press do not reduce it, because
# the read noise is less than a count.
_STEADY = 0.014
_PLACES = 65  # positions between which the variance is interpolated


class Certainty:
    """Standard deviation of the positions of a strip; `average` samples are in a reading.

    >>> Certainty.of(["nonsense"]) is None
    True
    """

    def __init__(self, made: Any, spectra: Any, average: int):
        self.average = average
        tables = made.tables
        low_um, high_um = self._ends_um = spectra.ends_um
        x_um = np.linspace(low_um, high_um, _PLACES)
        logs, slopes = spectra.logs(x_um), spectra.slopes(x_um)
        count = tables[SEGMENTS]
        weights, firm = [], []
        for i in range(count):
            place = tables[BOUNDS + 2 * i + 1]
            six = np.array(tables[place : place + 2 * CHANNELS], float) / ONE_Q13
            weights.append(six[:CHANNELS])
            _, at_um, _, offsets = columns_of(tables, place + 2 * CHANNELS, 4)
            at = spectra.logs(np.array(at_um, float))
            firm.append(at @ six[CHANNELS:] - np.array(offsets, float) / ONE_Q20)
        segment = ((x_um - low_um) / (high_um - low_um) * count).astype(int).clip(0, count - 1)
        own = np.array(weights)[segment]
        counts = np.exp2(logs)
        # Squares of the change of the position by one count of each channel.
        by_count = (own / counts / math.log(2)) ** 2 / (own * slopes).sum(1, keepdims=True) ** 2
        self._firm = float(np.concatenate(firm).mean())
        self._constant = by_count.sum(axis=1).tolist()
        self._by_light = ((by_count * counts).sum(axis=1) * _PER_COUNT).tolist()

    @classmethod
    def of(cls, lines: Sequence[str] | None, average: int = 1) -> Certainty | None:
        """Return that of a strip at rest; None if its lines are unknown or have no spectra."""
        try:
            spectra = press_spectra(lines)
            return None if spectra is None else cls(Calibration(lines), spectra, average)
        except (CalibrationError, ValueError):
            return None  # the calibration in a recording is not validated

    @classmethod
    def by_sensor(
        cls, lines: Sequence[Sequence[str] | None], infos: Sequence[Mapping[str, Any]]
    ) -> dict[int, Certainty]:
        """Return those of a board's sensors, from their calibrations and replies to ``hello``."""
        pairs = enumerate(zip(lines, infos))
        found = {i: cls.of(one, info.get("average") or 1) for i, (one, info) in pairs}
        return {i: one for i, one in found.items() if one is not None}

    def sigma_um(self, position_um: Any, brightness: Any) -> Any:
        """Return the standard deviation in um; also for arrays. `brightness` is in log2 units."""
        low_um, high_um = self._ends_um
        place_um = np.linspace(low_um, high_um, _PLACES)
        constant = np.interp(position_um, place_um, self._constant)
        by_light = np.interp(position_um, place_um, self._by_light)
        dimmer = np.exp2(self._firm - np.asarray(brightness))
        constant = constant * (_CONSTANT / self.average + _STEADY)
        return np.sqrt(constant * dimmer**2 + by_light / self.average * dimmer)

    def sigma_of(self, position_um: float, brightness: float) -> float:
        """Return what `sigma_um` does for one reading, in a tenth of its time."""
        low_um, high_um = self._ends_um
        at = (position_um - low_um) / (high_um - low_um) * (_PLACES - 1)
        at = min(max(at, 0.0), _PLACES - 1.000001)
        i = int(at)
        share = at - i
        constant = self._constant[i] + share * (self._constant[i + 1] - self._constant[i])
        by_light = self._by_light[i] + share * (self._by_light[i + 1] - self._by_light[i])
        dimmer = 2.0 ** (self._firm - brightness)
        constant *= _CONSTANT / self.average + _STEADY
        return math.sqrt(constant * dimmer**2 + by_light / self.average * dimmer)
