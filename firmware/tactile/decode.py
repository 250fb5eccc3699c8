"""Counts to position and force: six logarithms, four dot products, tables.

With L_i = log2(counts_i - dark_i), Eq. 1 of the paper is linear in the filtering length x and the
logarithm of the coupled light. Weights that add up to 0 leave x (the position contrast), weights
that add up to 1 and cancel the decay leave the light (the brightness). What is best changes along
the strip, as the counts do: a coarse contrast chooses the segment whose weights are used. One more
set tells whether one press can have made this spectrum. Integers of 31 bits only, allocates
nothing.
"""

from .log2 import log2_q20
from .smux import CHANNELS

TOUCHING = 1 << 0
SATURATED = 1 << 1
TOO_DARK = 1 << 2
DARK_SUBTRACTED = 1 << 3
MISFIT = 1 << 4
DROPPED = 1 << 5
NOT_CALIBRATED = 1 << 6
LED_OFF = 1 << 7

DARK_SAMPLES = 4  # a dark frame is the sum of these
AVERAGE_MAX = 64  # DARK_SAMPLES * AVERAGE_MAX full-scale counts reach 2**24


def dot(weights, logs):
    """Return the sum of weight (Q13) times logarithm (Q20), in Q20.

    Split so that nothing passes 31 bits for logs below 2**25 and weights whose absolute values
    add up to 2**16 at most.
    """
    high = low = 0
    for i in range(CHANNELS):
        weight = weights[i]
        log = logs[i]
        high += weight * (log >> 13)
        low += weight * (log & 8191)
    return high + (low >> 13)


def segment(knots, value):
    """Return i with knots[i] <= value < knots[i + 1], or the nearest segment's."""
    low = 0
    high = len(knots) - 1
    while high - low > 1:
        middle = (low + high) >> 1
        if value < knots[middle]:
            high = middle
        else:
            low = middle
    return low


def below(bounds, value):
    """Return the last i with bounds[i] <= value, or 0."""
    i = len(bounds) - 1
    while i > 0 and value < bounds[i]:
        i -= 1
    return i


def interpolate(knots, values, i, at):
    """Return the piecewise-linear value at `at`, which lies in segment i or is clamped to it."""
    start = knots[i]
    width = knots[i + 1] - start
    offset = min(max(at - start, 0), width)
    return values[i] + (offset * (values[i + 1] - values[i]) + (width >> 1)) // width


class Decode:
    """Turns sums of counts into the fields of a TOUCH frame, kept as attributes.

    Attributes
    ----------
    flags : int
        Bits of this module; `DROPPED` is the framer's.
    contrast, brightness : int
        Q20, in units of log2.
    position_um, force_mN : int
        0 where the flags say that they cannot be known.
    """

    def __init__(self):
        self.calibration = None
        self.flags = NOT_CALIBRATED
        self.contrast = self.brightness = self.position_um = self.force_mN = 0
        self._touching = False
        self._logs = [0] * CHANNELS

    @property
    def touching(self):
        """Whether a finger is on the strip, with hysteresis."""
        return self._touching

    def update(self, sums, samples, dark, flags):
        """Decode one reading.

        Parameters
        ----------
        sums : sequence of int
            Six sums of counts over `samples` samples.
        samples : int
            1 to `AVERAGE_MAX`.
        dark : sequence of int
            Six sums over `DARK_SAMPLES` dark samples, or zeros.
        flags : int
            What is known already: `SATURATED`, `DARK_SUBTRACTED`, `LED_OFF`.
        """
        self.contrast = self.brightness = self.position_um = self.force_mN = 0
        calibration = self.calibration
        if calibration is None:
            flags |= NOT_CALIBRATED
        if not flags & LED_OFF:
            if self._take_logs(sums, samples, dark):
                if calibration is not None:
                    flags |= self._estimate(calibration, samples)
            else:
                flags |= TOO_DARK
        self._decide(calibration, flags)
        if self._touching:
            flags |= TOUCHING
        self.flags = flags

    def _take_logs(self, sums, samples, dark):
        for i in range(CHANNELS):
            net = sums[i] * DARK_SAMPLES - samples * dark[i]
            if net <= 0:
                return False
            self._logs[i] = log2_q20(net)
        return True

    def _estimate(self, calibration, samples):
        logs = self._logs
        self.contrast = dot(calibration.coarse, logs)
        part = calibration.segments[below(calibration.bounds, self.contrast)]
        contrast = dot(part.position, logs)
        i = segment(part.contrasts, contrast)
        brightness = dot(part.force, logs) - log2_q20(samples * DARK_SAMPLES)
        brightness -= interpolate(part.contrasts, part.offsets, i, contrast)
        self.brightness = brightness
        if brightness < calibration.brightnesses[0]:
            return TOO_DARK
        self.position_um = interpolate(part.contrasts, part.positions_um, i, contrast)
        expected = interpolate(part.contrasts, part.fits, i, contrast)
        i = segment(calibration.brightnesses, brightness)
        self.force_mN = interpolate(calibration.brightnesses, calibration.forces_mN, i, brightness)
        tolerance = interpolate(calibration.brightnesses, calibration.tolerances, i, brightness)
        if abs((dot(calibration.fit, logs) >> 8) - expected) > tolerance:
            return MISFIT
        return 0

    def _decide(self, calibration, flags):
        if flags & LED_OFF:
            return  # blind for a moment: what was touched stays touched
        if calibration is None or flags & TOO_DARK:
            self._touching = False
        elif self._touching:
            self._touching = self.force_mN >= calibration.touch_off_mN
        else:
            self._touching = self.force_mN >= calibration.touch_on_mN
