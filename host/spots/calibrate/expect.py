"""From the lines of a calibration to the spectra that it expects of a press.

A board needs three sums of logarithms: for the position, for the force, and for what one press
cannot do. The lines give them at knots along the strip. Three sums do not fix six channels at
one place; but each segment has weights of its own, and one smooth curve for each channel has to
give the sums of all of them. A weak preference for straight curves decides what is left open.
"""

from __future__ import annotations

import numpy as np
from numpy.polynomial import chebyshev

from spots_device.calibration import ONE_Q13, Calibration
from spots_device.log2 import ONE as ONE_Q20
from spots_device.smux import CHANNELS

_DEGREE = 7
_PLACES = 65
_ONE_Q12 = 1 << 12
# How far off the sums are by rounding of places and values to integers, in log2 units.
_SUM_SIGMA, _MISFIT_SIGMA = 5e-5, 1e-4
# How large the Chebyshev coefficient of degree n is expected to be: this over n squared.
_COEFFICIENT_SIGMA = 3.0


def expected(lines, strain_ppm: int = 0) -> tuple[np.ndarray, np.ndarray]:
    """Return the log2 counts that each channel should have, by the place of a press.

    Parameters
    ----------
    lines : sequence of str
        See `spots_device.calibration`.
    strain_ppm : int

    Returns
    -------
    position_um : numpy.ndarray, shape (n,)
        Even steps along the strip.
    logs : numpy.ndarray, shape (n, 6)
        log2 of the dark-subtracted counts, less the brightness that the board computes. In counts
        good to 3 % of those of the brightest channel.

    Raises
    ------
    spots_device.calibration.CalibrationError
        If the lines are not a calibration, or do not go up to that strain.
    """
    made = Calibration(lines, strain_ppm)
    places = np.concatenate([segment.positions_um for segment in made.segments])
    low, high = places.min(), places.max()

    def polynomials(position_um):
        share = (np.asarray(position_um) - low) / (high - low)
        return chebyshev.chebvander(2 * share - 1, _DEGREE)

    rows, values = [], []
    for segment in made.segments:
        basis = polynomials(segment.positions_um)
        for weights, knots, one, sigma in (
            (segment.position, segment.contrasts, ONE_Q20, _SUM_SIGMA),
            (segment.force, segment.offsets, ONE_Q20, _SUM_SIGMA),
            (made.fit, segment.fits, _ONE_Q12, _MISFIT_SIGMA),
        ):
            rows.append(np.kron(np.array(weights) / ONE_Q13, basis) / sigma)
            values.append(np.array(knots) / one / sigma)
    degrees = np.arange(_DEGREE + 1)
    rows.append(np.kron(np.eye(CHANNELS), np.diag(degrees**2 / _COEFFICIENT_SIGMA)))
    values.append(np.zeros(len(rows[-1])))
    found, *_ = np.linalg.lstsq(np.concatenate(rows), np.concatenate(values), rcond=None)
    position_um = np.linspace(low, high, _PLACES)
    return position_um, polynomials(position_um) @ found.reshape(CHANNELS, -1).T
