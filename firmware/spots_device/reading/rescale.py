"""Converts a calibration to another exposure; imported only if the exposure differs.

Another exposure shifts the logarithms of all six counts of a reading by the same value. So
positions do not change, and the brightness at each force is shifted by this value. A shorter
exposure gives fewer counts and more relative noise. So the force at which a touch begins is raised
to the first force in the table that gives at least as many counts as before, or to the last one if
none does. The force at which a touch ends is raised in the same ratio.
"""

from .log2 import log2_q20


def rescale(calibration, exposure_us):
    """Convert the tables of a calibration in place to another exposure."""
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
    calibration.find_cross()


def _first(ascending, value):
    """Return the index of the first number in `ascending` that is >= `value`, or the last index."""
    last = len(ascending) - 1
    i = 0
    while i < last and ascending[i] < value:
        i += 1
    return i
