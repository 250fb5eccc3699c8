"""Computes from the lines of a calibration how the spectrum of a press depends on its force.

The lines contain corrections of the position and of the misfit, see `cross`. Each is a weighted sum
of the changes of the channels, and each segment of the strip has its own weights. One smooth change
of each channel matches the sums of all segments.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.polynomial import chebyshev
from numpy.typing import ArrayLike

from spots_device.reading.calibration import Calibration
from spots_device.reading.calibration_lines import ONE_Q13
from spots_device.reading.decode import CROSS
from spots_device.reading.log2 import ONE as ONE_Q20
from spots_device.sensor.smux import CHANNELS

from .decoded import Decoded, fit_of, segments_of, shares_of
from .fit import ONE_Q12

_PLACES = 3  # number of coefficients of the polynomial in the position
# Errors of the sizes, because they are a product's, and expected size of a change in log2 units.
_SIZE_UM, _SIZE_Q12, _CHANGE = 10.0, 2.0, 0.05


class CrossLines:
    """Change of the spectrum of a press with its force, relative to a firm press.

    It is that of the lines of a calibration, see `spots_device.reading.calibration_lines`.
    """

    def __init__(self, lines: Sequence[str]):
        self._table = Calibration(lines)
        self._decode = Decoded()
        self._decode.calibration = self._table
        self._ends_um = 0.0, self._table.length_um
        self._has_cross = bool(self._table.tables[CROSS])
        if self._has_cross:
            self._coefficients = self._solve()

    def logs(self, x_um: float, counts: ArrayLike) -> np.ndarray:
        """Return the change of log2 of each channel's counts in a press.

        The counts are dark-subtracted, at the exposure of the calibration. Zeros if the calibration
        has no cross-sensitivity.
        """
        if not self._has_cross:
            return np.zeros(CHANNELS)
        self._decode.update_mean(counts)
        brightnesses = self._table.brightnesses
        share = np.interp(self._decode.brightness, brightnesses, shares_of(self._table)) / ONE_Q12
        return share * (self._places([x_um])[0] @ self._coefficients)

    def _places(self, x_um) -> np.ndarray:
        low, high = self._ends_um
        return chebyshev.chebvander(2 * (np.asarray(x_um) - low) / (high - low) - 1, _PLACES - 1)

    def _solve(self) -> np.ndarray:
        test, rows, values = np.array(fit_of(self._table)) / ONE_Q13, [], []
        for segment in segments_of(self._table):
            x_um, fits = np.array(segment.positions_um, float), np.array(segment.fits) / ONE_Q12
            sizes_um, sizes_q12 = map(np.array, segment.cross)
            slopes = np.gradient(np.array(segment.contrasts) / ONE_Q20, x_um)
            # A contrast that is larger by `slopes` seems to be 1 um further along the strip.
            rows.append(np.kron(self._places(x_um), np.array(segment.position) / ONE_Q13))
            rows[-1] /= _SIZE_UM * slopes[:, None]
            values.append(-sizes_um / _SIZE_UM)
            rows.append(np.kron(self._places(x_um), test) * (ONE_Q12 / _SIZE_Q12))
            tilt = np.gradient(fits, x_um) * ONE_Q12
            values.append((sizes_q12 - tilt * sizes_um) / _SIZE_Q12)
        # The mean of the channels is 0.
        rows.append(np.kron(np.eye(_PLACES), np.ones(CHANNELS)) * ONE_Q12)
        values.append(np.zeros(_PLACES))
        rows.append(np.eye(_PLACES * CHANNELS) / _CHANGE)
        values.append(np.zeros(_PLACES * CHANNELS))
        found, *_ = np.linalg.lstsq(np.concatenate(rows), np.concatenate(values), rcond=None)
        return found.reshape(_PLACES, CHANNELS)
