"""Computes the spectrum of a press at each position from a calibration.

The lines of a calibration contain three weighted sums of log2(counts) for each of many positions
along the strip (knots). The sums give the position, the force, and the misfit: how far a spectrum
is from that of one press. Three sums do not determine six channels at one position. But the weights
differ between segments of the strip, and one smooth curve per channel must match the sums of all
segments. Weak regularisation towards straight curves makes the solution unique.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.polynomial import chebyshev

from spots_device.reading.calibration import Calibration
from spots_device.reading.calibration_lines import ONE_Q13
from spots_device.reading.log2 import ONE as ONE_Q20
from spots_device.sensor.smux import CHANNELS

from .decoded import fit_of, segments_of
from .fit import ONE_Q12

_DEGREE = 7  # of the curve of each channel, a Chebyshev series in the position
_PLACES = 65  # number of positions in the result
# Rounding errors of the sums in log2 units; the lines contain integers only.
_SUM_SIGMA, _MISFIT_SIGMA = 5e-5, 1e-4
# Expected size of the Chebyshev coefficient of degree n, times n squared.
_COEFFICIENT_SIGMA = 3.0


def expected(lines: Sequence[str], strain_ppm: int = 0) -> tuple[np.ndarray, np.ndarray]:
    """Return n positions along the strip in um, and the expected log2 of the counts there, (n, 6).

    The counts are those of presses whose brightness, as the board computes it in log2 units, is 0.
    Errors are at most 3 % of the counts of the brightest channel.
    `spots_device.reading.calibration_lines.CalibrationError` if the lines are not a calibration, or
    have no table for this strain.
    """
    made = Calibration(lines, strain_ppm)
    places = np.concatenate([segment.positions_um for segment in segments_of(made)])
    low, high = places.min(), places.max()

    def polynomials(position_um):
        share = (np.asarray(position_um) - low) / (high - low)
        return chebyshev.chebvander(2 * share - 1, _DEGREE)

    rows, values = [], []
    for segment in segments_of(made):
        basis = polynomials(segment.positions_um)
        for weights, knots, one, sigma in (
            (segment.position, segment.contrasts, ONE_Q20, _SUM_SIGMA),
            (segment.force, segment.offsets, ONE_Q20, _SUM_SIGMA),
            (fit_of(made), segment.fits, ONE_Q12, _MISFIT_SIGMA),
        ):
            rows.append(np.kron(np.array(weights) / ONE_Q13, basis) / sigma)
            values.append(np.array(knots) / one / sigma)
    degrees = np.arange(_DEGREE + 1)
    rows.append(np.kron(np.eye(CHANNELS), np.diag(degrees**2 / _COEFFICIENT_SIGMA)))
    values.append(np.zeros(len(rows[-1])))
    found, *_ = np.linalg.lstsq(np.concatenate(rows), np.concatenate(values), rcond=None)
    position_um = np.linspace(low, high, _PLACES)
    return position_um, polynomials(position_um) @ found.reshape(CHANNELS, -1).T
