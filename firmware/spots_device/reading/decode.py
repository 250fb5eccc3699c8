"""Computes position and force from counts: six logarithms, four dot products, tables.

According to Eq. 1 of the paper, L_i = log2(counts_i - dark_i) of channel i is linear in two
unknowns: the filtering length x (length of dyed guide that the light passes) and the logarithm of
the coupled light. A weighted sum of the L_i whose weights add up to 0 depends on x only: the
position contrast. A sum whose weights add up to 1 and cancel the decay depends on the light only:
the brightness. The best weights change along the strip, so a coarse contrast selects a segment with
its own weights. The misfit is another weighted sum: it shows how far the spectrum is from that of a
single press. All integers fit 31 bits; nothing is allocated.

This module defines the layout of the arrays that the functions of kernel.py read and write.
kernel_viper.py uses the same numbers as literals, because a look-up of a name is slow in machine
code.
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

# Indices of the array `tables` of a calibration. At `SEGMENTS`: the number of segments. At
# `FORCES`: the index of the table of forces. From `WEIGHTS` on: six weights for the coarse
# contrast, which selects a segment, and six for the misfit. From `BOUNDS` on, two elements for each
# segment: the coarse contrast at which the segment begins, and the index of its twelve weights;
# the segment's table is stored after these weights. A table is the number of its knots, then the
# knots, then its other columns.
SEGMENTS, FORCES, WEIGHTS, BOUNDS = 0, 1, 2, 14

# Indices of the array `state` of a strip. First the fields of a TOUCH frame: contrast and
# brightness are in Q20 of log2; unknown values are 0.
FLAGS, CONTRAST, BRIGHTNESS, POSITION_UM, FORCE_MN = range(5)
# Samples in the reading, samples in the floor, and log2 of their product in Q20.
SAMPLES, FLOOR_SAMPLES, LOG_SAMPLES = range(5, 8)
# From the calibration: forces at which a touch begins and ends, largest drift of the misfit (Q12).
TOUCH_ON_MN, TOUCH_OFF_MN, DRIFT_MAX = range(8, 11)
# Sum of the six sums of counts. kernel.py defines the elements before and after it.
LIGHT = 14
# Time without a touch in us. Change of the ambient light, see dark.py: light without a touch plus
# 1, or 0 from a dark window to the next reading without a touch; duration in us.
IDLE_US, LEVEL, ODD_US = range(20, 23)
# Dark frame: its age and largest age in us, us that a sample adds, and whether one is wanted (0, 1,
# or `CHECK`: a window for the present mean).
AGE_US, EVERY_US, AGE_STEP_US, WANTED = range(23, 27)
CHECK = 2
# Samples of the present reading; its flags; exposure; `DROPPED` if samples are missing before it;
# its flags before keys and contacts changed them; byte 0 of its TOUCH frame, or 0 if it is not
# streamed.
TAKEN, PENDING, EXPOSURE_US, MISSING, ESTIMATED, STREAMED = range(27, 33)
# Whether the baseline is tracked: 0, 1, or 2 if the next reading becomes the baseline. Samples of a
# complete reading. Least time without a touch before a dark frame, in us. Right shift from Q12 to
# the floor. Whether the baseline has been measured.
FOLLOWS, AVERAGE, IDLE_MIN_US, SHIFT, FOLLOWED = range(33, 38)
# Six elements each: sums of counts; sum of dark frame and baseline (`floor`), as sums over
# `FLOOR_SAMPLES`; baseline, and mean of the dark frame, both counts in Q12.
SUMS, FLOOR, REST, DARK = range(48, 72, 6)
STATE_SIZE = 72

# Indices of the array `head`, the header of a frame: kind and sensor, sequence number, low and high
# half of the time, the flag `DROPPED` if frames are missing before this frame, and how many us the
# time is earlier than `frame.Time32.last`.
KIND, SEQUENCE, TIME_LOW, TIME_HIGH, GAP, LESS_US = range(6)
HEAD_SIZE = 6

# Bits in the argument `flags` of `kernel.process`, and bits in its result, as documented there.
READ, SEND, TWO = 1 << 8, 1 << 9, 1 << 10
COMPLETE, ODD, DUE = 1 << 12, 1 << 13, 1 << 14

HEADER_SIZE = 7  # bytes of a frame before its body
CRC_SIZE = 4  # bytes of a CRC-32

DARK_SAMPLES = 64  # samples in the sums of a dark frame in replies

AVERAGE_MAX = 64  # 64 samples times 4 dark samples times full scale (65535) is just below 2**24

_NO_TABLES = array("i", bytes(4))


class Decode:
    """Inputs and results of `kernel.estimate` for one strip.

    Attributes
    ----------
    state : array of int
        Settings, sums and estimates of the strip, at the indices that this module defines; first
        the fields of the TOUCH frame.
    tables : array of int
        The tables of the calibration.
    """

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

    def scale(self, samples, dark_samples):
        """Set the number of samples in a reading, and in the sums that are subtracted from it.

        The product of both numbers must be at most 256: times the largest count, this is just below
        the limit of `log2.log2_q20`.
        """
        state = self.state
        state[SAMPLES] = samples
        state[FLOOR_SAMPLES] = dark_samples
        state[LOG_SAMPLES] = log2_q20(samples * dark_samples)


def columns_of(tables, place, count):
    """Return memory views of `count` columns of the table at the index `place` of `tables`.

    Column 0 contains the knots' arguments, for example contrasts; the others contain their values.
    """
    size = tables[place]
    columns = []
    for first in range(place + 1, place + 1 + count * size, size):
        columns.append(tables[first : first + size])
    return columns
