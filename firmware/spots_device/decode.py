"""Counts to position and force: six logarithms, four dot products, tables.

With L_i = log2(counts_i - dark_i), Eq. 1 of the paper is linear in the filtering length x and the
logarithm of the coupled light. Weights that add up to 0 leave x (the position contrast), weights
that add up to 1 and cancel the decay leave the light (the brightness). What is best changes along
the strip, as the counts do: a coarse contrast chooses the segment whose weights are used. One more
set measures the misfit to a single press. Integers of 31 bits only; allocates nothing.
"""

from array import array

from .kernel import SCRATCH, estimate

TOUCHING = 1 << 0
SATURATED = 1 << 1
TOO_DARK = 1 << 2
DARK_SUBTRACTED = 1 << 3
MISFIT = 1 << 4
DROPPED = 1 << 5
NOT_CALIBRATED = 1 << 6
LED_OFF = 1 << 7

DARK_SAMPLES = 64  # replies give a dark frame as sums over so many
AVERAGE_MAX = 64  # times 4 samples of a dark frame, full-scale counts reach 2**24


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
    dark_samples : int
        Over how many samples the dark frame that `update` gets is summed; times the samples of a
        reading at most 256.
    """

    def __init__(self):
        self.calibration = None
        self.dark_samples = 4
        self.flags = NOT_CALIBRATED
        self.contrast = self.brightness = self.position_um = self.force_mN = 0
        self._scratch = array("i", bytes(4 * SCRATCH))
        self._reading = array("i", bytes(4 * 4))

    def update(self, sums, samples, dark, flags):
        """Decode one reading.

        Parameters
        ----------
        sums : sequence of int
            Six sums of counts over `samples` samples.
        samples : int
            1 to `AVERAGE_MAX`.
        dark : sequence of int
            Six sums over `dark_samples` dark samples, or zeros.
        flags : int
            What is known already: `SATURATED`, `DARK_SUBTRACTED`, `LED_OFF`.
        """
        calibration = self.calibration
        if calibration is None:
            flags |= NOT_CALIBRATED
        if flags & LED_OFF:
            self.contrast = self.brightness = self.position_um = self.force_mN = 0
            # Blind for a moment: what was touched stays touched.
            self.flags = flags | self.flags & TOUCHING
            return
        reading = self._reading
        found = estimate(
            calibration, sums, samples, dark, self.dark_samples, self._scratch, reading
        )
        self.contrast = reading[0]
        self.brightness = reading[1]
        self.position_um = reading[2]
        self.force_mN = force_mN = reading[3]
        if found:
            flags |= TOO_DARK if found == 1 else MISFIT
        if force_mN:
            touching = self.flags & TOUCHING
            if force_mN >= (calibration.touch_off_mN if touching else calibration.touch_on_mN):
                flags |= TOUCHING
        self.flags = flags
