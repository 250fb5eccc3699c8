"""Computes position and force from counts: six logarithms, four dot products, tables.

According to Eq. 1 of the paper, L_i = log2(counts_i - dark_i) of channel i is linear in two
unknowns: the filtering length x (length of dyed guide that the light passes) and the logarithm of
the coupled light. A weighted sum of the L_i whose weights add up to 0 depends on x only: the
position contrast. A sum whose weights add up to 1 and cancel the decay depends on the light only:
the brightness. The best weights change along the strip, so a coarse contrast selects a segment with
its own weights. The misfit is another weighted sum: it shows how far the spectrum is from that of a
single press. All integers fit 31 bits; nothing is allocated.

The spectrum of a press can also depend on its force (cross-sensitivity). The calibration of such a
strip has two values for each position, and one for each force. The products of this value with
those two correct the position and the misfit.

This module defines the layout of the arrays that the functions of kernel.py read and write.
"""

from array import array

from .log2 import log2_q20

# Flags of a reading, see docs/extend/protocol.md.
TOUCHING = 1 << 0
SATURATED = 1 << 1
TOO_DARK_BIT = 2
TOO_DARK = 1 << TOO_DARK_BIT
DARK_SUBTRACTED = 1 << 3
MISFIT_BIT = 4
MISFIT = 1 << MISFIT_BIT
DROPPED = 1 << 5
NOT_CALIBRATED = 1 << 6
LED_OFF = 1 << 7
# An untrusted reading that is good enough for a key: it fits one press after subtraction of the
# drift, so the strip has drifted, or there are two fingers. All eight bits are in use.
FITS_WITH_DRIFT = MISFIT | TOO_DARK

# Indices of the array `tables` of a calibration. After `BOUNDS`, two elements for each segment: the
# coarse contrast at which the segment begins (Q20), and the index of its twelve weights; the
# segment's table is stored after these weights. A table is the number of its knots, then the knots,
# then its other columns.
SEGMENTS = 0  # number of segments
FORCES = 1  # index of the table of forces
CROSS = 2  # um: length, if the tables have the columns of the cross-sensitivity; else 0
WEIGHTS = 3  # Q13: six weights of the coarse contrast, then six of the misfit
BOUNDS = 15

# Indices of the array `state` of a strip. First the fields of a TOUCH frame; unknown values are 0.
# Machine code for an element up to 31 is shorter.
FLAGS = 0  # bits, see above
CONTRAST = 1  # Q20 of log2
BRIGHTNESS = 2  # Q20 of log2
POSITION_UM = 3  # um
FORCE_MN = 4  # mN
SAMPLES = 5  # samples in the reading
FLOOR_SAMPLES = 6  # samples in the sums of `FLOOR`
LOG_SAMPLES = 7  # Q20 of log2: product of the two numbers of samples
TOUCH_ON_MN = 8  # mN: force at which a touch begins, from the calibration
TOUCH_OFF_MN = 9  # mN: force at which a touch ends, from the calibration
DRIFT_MAX = 10  # Q12: largest drift of the misfit, from the calibration
DRIFT = 11  # Q12: drift of the misfit in the middle of the strip, see lone.py
LEARNS = 12  # readings until a touch gives the drift; 0 after that
SEEN = 13  # Q12: mean of `OFF_Q12` in the last touch of one finger, or `NONE`
LIGHT = 14  # counts: sum of the six sums
MISFIT_Q12 = 15  # Q12: misfit to one press, if the position is known
TOLERANCE_Q12 = 16  # Q12: tolerance of this misfit
OFF_Q12 = 17  # Q12: misfit minus drift, at the position of the reading
DOUBT = 18  # whether two fingers may have begun this touch: 1 first reading, 2 later, 0 no
SLOPE = 19  # Q10: change of the drift in 1024 um
IDLE_US = 20  # us: time without a touch
# Change of the ambient light, see dark.py.
LEVEL = 21  # counts + 1: sum of the floor; 0 from a dark window until a reading without a touch
ODD_US = 22  # us: duration
# Dark frame.
AGE_US = 23  # us: its age
EVERY_US = 24  # us: its largest age
AGE_STEP_US = 25  # us that a sample adds to the age
WANTED = 26  # whether one is wanted: 0, 1, or `CHECK`
# Reading.
TAKEN = 27  # samples of the present reading
PENDING = 28  # bits: flags of the present reading
EXPOSURE_US = 29  # us
MISSING = 30  # `DROPPED` if samples are missing before the reading
DUE = 31  # bool: a dark window must begin, see `kernel.process`
STREAMED = 32  # byte 0 of its TOUCH frame; 0 if it is not streamed
# Subtracted light.
BELOW = 33  # bool: a channel is clearly below the floor, so the ambient light has faded
AVERAGE = 34  # samples of a complete reading
IDLE_MIN_US = 35  # us: least time without a touch before a dark frame
SHIFT = 36  # right shift from Q12 to the floor
SHADE_US = 37  # us: age from which the hand of a touch may shade the light of the dark frame
# Sums of weights times logarithms, Q20 of log2: four elements, only in machine code.
COARSE_SUM = 38
MISFIT_SUM = 39
CONTRAST_SUM = 40
BRIGHTNESS_SUM = 41
# Six elements each, one for each channel.
LOGS = 42  # Q20 of log2: logarithms of the light
SUMS = 48  # counts: sums over `SAMPLES`
FLOOR = 54  # counts: dark frame and baseline, as sums over `FLOOR_SAMPLES`
BASELINE = 60  # counts in Q12: baseline
DARK = 66  # counts in Q12: mean of the dark frame
# Up to five values that `kernel.look_up` returns: position, expected misfit, offset of the
# brightness, and two sizes of the cross-sensitivity. The second look-up replaces the first three by
# force, tolerance, and share of the cross-sensitivity.
FOUND = 72
# Touch and sticking contact, see sticking.py.
STICK = 77  # counts in Q12: light that sticks; six elements, one for each channel
STUCK = 83  # counts in Q8: sum of these six
PEAK = 84  # Q20 of log2: largest brightness of the present or last touch; 0 before the first one
PEAK_LIGHT = 85  # counts: largest sum of the six counts of a sample in this touch
FAINT = 86  # whether the last reading of this touch had less than a tenth of its peak
# Readings since a touch ended that agree with `STICK`, one more if the first of them confirmed it;
# 0 in a touch, -1 if there is too much light.
AGREE = 87
FADE = 88  # Q24: share of `STICK` that decays in 64 us
TOUCHED = 89  # `TOUCHING` if a finger touched in the last reading with the LED on, else 0
# `TOO_DARK` if position or force is beyond the calibrated range, else 0; only in portable code.
BEYOND = 90
# One finger or two, see lone.py. Machine code uses these elements by a second pointer.
LATE = 91
MIDDLE_UM = 91  # um: half the length of the strip
BEGUN_US = 92  # us: time since the touch began
X_FIRM_UM = 93  # um: position of the last firm reading; -`NONE` before the first one
MEAN = 94  # Q16: mean of `OFF_Q12` in the last firm readings
TOLERANCE_FIRM = 95  # Q12: least tolerance of these readings
LONE = 96  # bool: all firm readings of the touch are at one position
EXCESS = 97  # sum of weights times excesses of the misfit
WEIGHT = 98  # sum of these weights
FRESH = 99  # touches until a jump of the drift is known everywhere; `UNKNOWN` after a start
JUMPED = 100  # Q12: jump of the drift in this touch
STATE_SIZE = 101

OFF_MAX = 1 << 20  # Q12
UNKNOWN = 7  # value of `FRESH`: no touch has shown the drift yet
NONE = 1 << 24  # um or Q12: a value that is unknown
MOVES_US = 50_000  # us: a touch that moves so early may be of two fingers
MOVED_UM = 800  # um: largest motion of one finger between two firm readings

COUNT_MAX_Q12 = 65_535 << 12  # largest count

CHECK = 2  # value of `WANTED`: a dark window for the present mean

# Limits of `kernel.process`.
IDLE_US_MAX = 1_000_000  # us: largest stored time without a touch
BEGUN_US_MAX = 10_000_000  # us: largest stored time of a touch
SHADED_US = 200_000  # us: least time of a touch before a dark sample; taps are shorter
# The ambient light has changed if one of two things lasts for `ODD_US_MAX`: a touch does not fit
# one press, or the sum of the counts without a touch differs by more than `ODD_COUNTS` from that of
# dark frame and baseline.
ODD_US_MAX = 300_000  # us
ODD_COUNTS = 24  # counts
BELOW_COUNTS = 8  # counts of a channel below the floor, which no press can cause
BELOW_SHIFT = 4  # such a reading counts this often, as a power of 2
ODD_EVERY_US = 2_000_000  # us: least age of a dark frame that is taken again for this reason
ALIEN = 8  # tolerances: presses cause a smaller misfit, ambient light a larger one
# A force is beyond the calibrated range if its light is more than this above the largest one, Q20
# of log2 (2 %). A position is beyond it by half the distance of two knots, or, with the
# cross-sensitivity, if the corrected position is beyond the strip by 1/64 of the strip's length.
BEYOND_Q20 = 30_000
FAR_LOG2 = 6
OUTSIDE_UM = 1 << 20  # um: a contrast far beyond its table, see `kernel._beyond`

# Limits of `sticking.unstick`.
LEFT = 3_483_000  # 10, as a difference of brightness in Q20 of log2: below its peak, a touch ends
LEFT_LOG2 = 3  # log2 of the largest ratio of a touch's peak to the light that sticks after it
STUCK_NOISE = 5 << 8  # counts in Q8: largest noise of a sum over six channels
STUCK_LEAST = 8 << 8  # counts in Q8: less light is not subtracted
STICK_MAX = (1 << 24) - 1  # counts in Q12
AGREE_MAX = 16
STEPS_MAX = 15_625  # 1 s, in steps of 64 us
SHARE_MAX = 1 << 14  # Q16: largest share that decays in a reading
FADE_START = 54  # 20 s, as a time constant
FADE_MIN = 18  # 60 s
FADE_MAX = 21_475  # 0.05 s

# Indices of the array `head`, the header of a frame.
KIND = 0  # kind and sensor
SEQUENCE = 1  # sequence number
TIME_LOW = 2  # us: low half of the time
TIME_HIGH = 3  # us: high half of the time
GAP = 4  # the flag `DROPPED` if frames are missing before this frame
LESS_US = 5  # us by which the time is earlier than `frame.Time32.last`
HEAD_SIZE = 6

# Indices of the list `work` of a strip: what `kernel.process` reads and changes.
STATE = 0  # state of the strip
TABLES = 1  # tables of the calibration; 0 segments mean that there is none
COUNTS = 2  # six counts of the sample
HEAD = 3  # this, and the next two: as for `kernel.frame`
PAYLOAD = 4
ENCODED = 5
# None, or a function without arguments for a complete reading: it may change the reading before the
# frame is encoded, and returns whether two fingers may have caused it.
USE = 6
WORK_SIZE = 7

HEADER_SIZE = 7  # bytes of a frame before its body
CRC_SIZE = 4  # bytes of a CRC-32
TOUCH_SIZE = HEADER_SIZE + 15  # bytes of header and body of a TOUCH frame

DARK_SAMPLES = 64  # samples in the sums of a dark frame in replies

AVERAGE_MAX = 64  # 64 samples times 4 dark samples times full scale (65535) is just below 2**24

_NO_TABLES = array("i", bytes(4))


class Decode:
    """Inputs and results of `kernel.estimate` for one strip."""

    def __init__(self):
        self.state = array("i", bytes(4 * STATE_SIZE))  # first the fields of the TOUCH frame
        self.state[FLAGS] = NOT_CALIBRATED
        self.state[FADE] = FADE_START
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
            self.state[MIDDLE_UM] = calibration.length_um >> 1
            self.state[FRESH] = UNKNOWN

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
