"""Computes position and force from counts: six logarithms, four dot products, tables.

With L_i = log2(counts_i - dark_i), Eq. 1 of the paper is linear in the filtering length x and the
logarithm of the coupled light. Weights with the sum 0 give a value that depends on x only: the
position contrast. Weights with the sum 1 that cancel the decay give a value that depends on the
light only: the brightness. The best weights change along the strip, so a coarse contrast selects
a segment with its own weights. Another set of weights measures the misfit to a single press.
All integers fit 31 bits; nothing is allocated.

This module has the layout of the arrays that the functions of kernel.py read and write.
kernel_viper.py has the same numbers as literals, because a name costs a look-up there.
"""

from array import array

from .log2 import log2_q20

# Flags of a reading, see docs/protocol.md.
TOUCHING = 1 << 0
SATURATED = 1 << 1
TOO_DARK = 1 << 2
DARK_SUBTRACTED = 1 << 3
MISFIT = 1 << 4
DROPPED = 1 << 5
NOT_CALIBRATED = 1 << 6
LED_OFF = 1 << 7

# `state` of a strip. First the fields of a TOUCH frame: contrast and brightness in Q20 of log2;
# values that are not known are 0.
FLAGS, CONTRAST, BRIGHTNESS, POSITION_UM, FORCE_MN = range(5)
# Samples in the reading, samples in the floor, and log2 of their product in Q20.
SAMPLES, FLOOR_SAMPLES, LOG_SAMPLES = range(5, 8)
# From the calibration.
TOUCH_ON_MN, TOUCH_OFF_MN, DRIFT_MAX = range(8, 11)
# Drift of the misfit, see `kernel._judge`.
DRIFT, LEARNS, SEEN = range(11, 14)
LIGHT = 14  # sum of the six sums
# Misfit to one press and its tolerance in Q12, if the position is known.
MISFIT_Q12, TOLERANCE_Q12 = 15, 16
LOGS = 17  # work: six logarithms
FOUND = 27  # work: up to three values of a table
STATE_SIZE = 30

# `head` of a frame: kind and sensor, sequence, halves of the time, and the flag `DROPPED` if frames
# or samples are missing before this one.
KIND, SEQUENCE, TIME_LOW, TIME_HIGH, GAP = range(5)
HEAD_SIZE = 5

HEADER_SIZE = 7  # bytes of a frame before its body
TOUCH_BODY = "BiiiH"  # flags, contrast, brightness, position_um, force_mN
TOUCH_SIZE = HEADER_SIZE + 15
CRC_SIZE = 4  # bytes of a CRC-32

# `tables` of a calibration. `WEIGHTS` has six weights for the contrast that selects a segment, and
# six for the misfit. From `BOUNDS` on there are two elements for each segment: the contrast at
# which it begins, and the place of its twelve weights. The segment's table follows its weights.
# `FORCES` has the place of the table of forces. A table is the number of its knots, the knots, and
# its columns.
SEGMENTS, FORCES, WEIGHTS, BOUNDS = 0, 1, 2, 14

DARK_SAMPLES = 64  # samples in the sums of a dark frame in replies
AVERAGE_MAX = 64  # with 4 samples of a dark frame, full-scale counts reach 2**24


_NO_TABLES = array("i", bytes(4))


def _field(place):
    """Return a property for an element of `Decode.state`."""

    def get(self):
        return self.state[place]

    def put(self, value):
        self.state[place] = value

    return property(get, put)


class Decode:
    """Converts sums of counts to the fields of a TOUCH frame, which are its attributes.

    Attributes
    ----------
    state : array of int
        The fields, and all else that `kernel.estimate` needs of a strip.
    tables : array of int
        The tables of the calibration.
    flags : int
        Flag bits of this module, without `DROPPED`, which the framer sets.
    contrast, brightness : int
        Q20, in units of log2.
    position_um, force_mN : int
        Position in um and force in mN; 0 if the flags mark them as unknown.
    """

    flags = _field(FLAGS)
    contrast = _field(CONTRAST)
    brightness = _field(BRIGHTNESS)
    position_um = _field(POSITION_UM)
    force_mN = _field(FORCE_MN)

    def __init__(self):
        self.state = array("i", bytes(4 * STATE_SIZE))
        self.state[FLAGS] = NOT_CALIBRATED
        self.calibration = None
        self.scale(1, 4)

    @property
    def calibration(self):
        """The `calibration.Calibration` in use, or None."""
        return self._calibration

    @calibration.setter
    def calibration(self, calibration):
        self._calibration = calibration
        self.tables = _NO_TABLES
        self.compensation = None
        if calibration is not None:
            self.compensation = calibration.compensation
            self.tables = calibration.tables
            self.state[TOUCH_ON_MN] = calibration.touch_on_mN
            self.state[TOUCH_OFF_MN] = calibration.touch_off_mN
            self.state[DRIFT_MAX] = calibration.drift_max

    @property
    def dark_samples(self):
        """Number of samples in the dark sums that `update` gets.

        The product of this number and the number of samples in a reading must be at most 256.
        """
        return self.state[FLOOR_SAMPLES]

    def scale(self, samples, dark_samples):
        """Set the number of samples in readings and in the dark sums."""
        state = self.state
        state[SAMPLES] = samples
        state[FLOOR_SAMPLES] = dark_samples
        state[LOG_SAMPLES] = log2_q20(samples * dark_samples)

    def update(self, sums, samples, dark, flags):
        """Decode one reading.

        Parameters
        ----------
        sums : sequence of int
            Six sums of counts over `samples` samples.
        samples : int
            Samples in the reading, 1 to `AVERAGE_MAX`.
        dark : sequence of int
            Six sums of counts over `dark_samples` dark samples; zeros without a dark frame.
        flags : int
            Flags of the sums: `SATURATED`, `DARK_SUBTRACTED`, `LED_OFF`.
        """
        from .kernel import estimate  # kernel.py imports this module

        if samples != self.state[SAMPLES]:
            self.scale(samples, self.dark_samples)
        estimate(self.state, self.tables, sums, dark, flags)
