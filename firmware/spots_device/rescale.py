"""A calibration turned into one for another exposure; loaded only under lamps.

All logarithms of a reading change alike: positions stay, and the brightness of each force moves.
A shorter exposure has more noise in proportion, so a touch begins where there is as much light as
at the exposure of the calibration.
"""

from .log2 import log2_q20


def rescale(calibration, exposure_us):
    """Change the tables of a `calibration.Calibration`.

    Parameters
    ----------
    calibration : calibration.Calibration
    exposure_us : int
        Of the readings that it is for.
    """
    made_us = calibration.conditions.exposure_us
    forces_mN = calibration.forces_mN
    brightnesses = calibration.brightnesses
    tolerances = calibration.tolerances
    shift = log2_q20(exposure_us) - log2_q20(made_us)
    if shift < 0:
        on_mN = calibration.touch_on_mN
        wanted = brightnesses[_first(forces_mN, on_mN)] - shift
        calibration.touch_on_mN = forces_mN[_first(brightnesses, wanted)]
        calibration.touch_off_mN = calibration.touch_off_mN * calibration.touch_on_mN // on_mN
    for i in range(len(brightnesses)):
        brightnesses[i] += shift
        if shift < 0:
            tolerances[i] = tolerances[i] * made_us // exposure_us


def _first(ascending, value):
    """Return the index of the first that is not below a value, or the last index."""
    last = len(ascending) - 1
    i = 0
    while i < last and ascending[i] < value:
        i += 1
    return i
