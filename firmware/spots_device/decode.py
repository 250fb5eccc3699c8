"""Computes position and force from counts: six logarithms, four dot products, tables.

By Eq. 1 of the paper, L_i = log2(counts_i - dark_i) of channel i is linear in two unknowns: the
filtering length x (length of dyed guide that the light passes) and the logarithm of the coupled
light. A weighted sum of the L_i whose weights add up to 0 depends on x only: the position contrast.
A sum whose weights add up to 1 and cancel the decay depends on the light only: the brightness. The
best weights change along the strip, so a coarse contrast selects a segment with its own weights.
Another weighted sum, the misfit, shows how far the spectrum is from that of a single press. All
integers fit 31 bits; nothing is allocated.

This module defines the layout of the arrays that the functions of kernel.py read and write.
kernel_viper.py uses the same numbers as literals, because each look-up of a name takes time there.
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

# Indices of the array `state` of a strip. First the fields of a TOUCH frame: contrast and
# brightness are in Q20 of log2; unknown values are 0.
FLAGS, CONTRAST, BRIGHTNESS, POSITION_UM, FORCE_MN = range(5)
# Samples in the reading, samples in the floor, and log2 of their product in Q20.
SAMPLES, FLOOR_SAMPLES, LOG_SAMPLES = range(5, 8)
# From the calibration: forces at which a touch begins and ends, largest drift of the misfit (Q12).
TOUCH_ON_MN, TOUCH_OFF_MN, DRIFT_MAX = range(8, 11)
# Sum of the six sums of counts. kernel.py defines the other elements.
LIGHT = 14
STATE_SIZE = 30

# Indices of the array `head`, the header of a frame: kind and sensor, sequence number, low and high
# half of the time, and the flag `DROPPED` if frames or samples are missing before this frame.
KIND, SEQUENCE, TIME_LOW, TIME_HIGH, GAP = range(5)
HEAD_SIZE = 5

HEADER_SIZE = 7  # bytes of a frame before its body
CRC_SIZE = 4  # bytes of a CRC-32

DARK_SAMPLES = 64  # samples in the sums of a dark frame in replies
AVERAGE_MAX = 64  # with 4 samples of a dark frame, full-scale counts reach 2**24

_NO_TABLES = array("i", bytes(4))


class Decode:
    """Inputs and results of `kernel.estimate` for one strip; the host has `views.Decoded`.

    Attributes
    ----------
    state : array of int
        Fields of the TOUCH frame, and the other values that `kernel.estimate` stores for a strip.
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
        """Set the number of samples in a reading, and in the sums of the dark frame.

        The product of both numbers is at most 256.
        """
        state = self.state
        state[SAMPLES] = samples
        state[FLOOR_SAMPLES] = dark_samples
        state[LOG_SAMPLES] = log2_q20(samples * dark_samples)
