"""Computes the spectrum of a press at each position from a calibration.

The lines of a calibration contain the spectra of firm presses on the strip at rest. Strain changes
them. The lines also contain three weighted sums of log2(counts) for each of many positions along
the strip (knots), at each strain. The sums give the position, the force, and the misfit: how far a
spectrum is from that of one press. They show the change, which is small and smooth.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.polynomial import chebyshev

from spots_device.reading.calibration import Calibration
from spots_device.reading.calibration_lines import ONE_Q13
from spots_device.reading.log2 import ONE as ONE_Q20
from spots_device.sensor.smux import CHANNELS

from ...common.press_spectra import press_spectra
from .decoded import fit_of, segments_of
from .fit import ONE_Q12

_DEGREE = 3  # of the change of each channel, a Chebyshev series in the position
_PLACES = 65  # number of positions in the result
# Rounding errors of the sums in log2 units; the lines contain integers only.
_SUM_SIGMA, _MISFIT_SIGMA = 5e-5, 1e-4
# Expected size of a coefficient of the change, divided by the strain; and its least value.
_CHANGE_SIGMA, _LEAST_SIGMA = 2.0, 1e-4


def expected(lines: Sequence[str], strain_ppm: int = 0) -> tuple[np.ndarray, np.ndarray] | None:
    """Return n positions along the strip in um, and the expected log2 of the counts there, (n, 6).

    The counts are those of presses whose brightness, as the board computes it in log2 units, is 0.
    Errors are at most 3 % of the counts of the brightest channel. None if the lines have no
    spectra. `spots_device.reading.calibration_lines.CalibrationError` if the lines are not a
    calibration, or have no table for this strain.
    """
    made, spectra = Calibration(lines, strain_ppm), press_spectra(lines)
    if spectra is None:
        return None
    strain = strain_ppm * 1e-6
    places = np.concatenate([segment.positions_um for segment in segments_of(made)])
    low, high = places.min(), places.max()

    def polynomials(position_um):
        share = (np.asarray(position_um) - low) / (high - low)
        return chebyshev.chebvander(2 * share - 1, _DEGREE)

    rows, values = [], []
    for segment in segments_of(made):
        place_um = np.array(segment.positions_um)
        basis, logs = polynomials(place_um), spectra.logs(place_um / (1 + strain))
        for weights, knots, one, sigma in (
            (segment.position, segment.contrasts, ONE_Q20, _SUM_SIGMA),
            (segment.force, segment.offsets, ONE_Q20, _SUM_SIGMA),
            (fit_of(made), segment.fits, ONE_Q12, _MISFIT_SIGMA),
        ):
            weights = np.array(weights) / ONE_Q13
            # The last unknown is the light of all channels, which gives the brightness 0.
            light = np.full((len(basis), 1), weights.sum())
            rows.append(np.hstack([np.kron(weights, basis), light]) / sigma)
            values.append((np.array(knots) / one - logs @ weights) / sigma)
    sigma = max(_CHANGE_SIGMA * strain, _LEAST_SIGMA)
    rows.append(np.eye(CHANNELS * (_DEGREE + 1), rows[0].shape[1]) / sigma)
    values.append(np.zeros(len(rows[-1])))
    found, *_ = np.linalg.lstsq(np.concatenate(rows), np.concatenate(values), rcond=None)
    position_um = np.linspace(low, high, _PLACES)
    change = polynomials(position_um) @ found[:-1].reshape(CHANNELS, -1).T
    return position_um, spectra.logs(position_um / (1 + strain)) + change + found[-1]
