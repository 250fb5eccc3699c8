"""Computes position and force from counts: six logarithms, four dot products, tables.

With L_i = log2(counts_i - dark_i), Eq. 1 of the paper is linear in the filtering length x and the
logarithm of the coupled light. Weights with the sum 0 give a value that depends on x only: the
position contrast. Weights with the sum 1 that cancel the decay give a value that depends on the
light only: the brightness. The best weights change along the strip, so a coarse contrast selects
a segment with its own weights. Another set of weights measures the misfit to a single press.
All integers fit 31 bits; nothing is allocated.
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

DARK_SAMPLES = 64  # samples in the sums of a dark frame in replies
AVERAGE_MAX = 64  # with 4 samples of a dark frame, full-scale counts reach 2**24


class Decode:
    """Converts sums of counts to the fields of a TOUCH frame, which are its attributes.

    Attributes
    ----------
    flags : int
        Flag bits of this module, without `DROPPED`, which the framer sets.
    contrast, brightness : int
        Q20, in units of log2.
    position_um, force_mN : int
        Position in um and force in mN; 0 if the flags mark them as unknown.
    dark_samples : int
        Number of samples in the dark sums that `update` gets. The product of this number
        and the number of samples in a reading must be at most 256.
    """

    def __init__(self):
        self.calibration = None
        self.dark_samples = 4
        self.flags = NOT_CALIBRATED
        self.contrast = self.brightness = self.position_um = self.force_mN = 0
        self._drift = self._learns = self._seen = 0
        self._scratch = array("i", bytes(4 * SCRATCH))
        self._reading = array("i", bytes(4 * 4))

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
        calibration = self.calibration
        if calibration is None:
            flags |= NOT_CALIBRATED
        if flags & LED_OFF:
            self.contrast = self.brightness = self.position_um = self.force_mN = 0
            # Without light a touch cannot be detected: the state of the touch does not change.
            self.flags = flags | self.flags & TOUCHING
            return
        scratch = self._scratch
        reading = self._reading
        found = estimate(calibration, sums, samples, dark, self.dark_samples, scratch, reading)
        self.contrast, self.brightness, self.position_um, force_mN = reading
        self.force_mN = force_mN
        misfit, tolerance = scratch[2], scratch[1]
        if found:
            flags |= TOO_DARK
        elif calibration and abs(misfit) > tolerance:
            flags |= MISFIT
        if force_mN:
            touching = self.flags & TOUCHING
            # A lamp or two fingers: light that fits no press begins a touch at twice the force.
            on_mN = calibration.touch_on_mN << (1 if flags & MISFIT else 0)
            if force_mN >= (calibration.touch_off_mN if touching else on_mN):
                flags |= TOUCHING
                # Drift shifts the misfit of every press alike. The third reading of a touch gives
                # this shift, if the previous touch gave the same: two fingers seldom touch together
                # twice in a row. A reading that fits one press up to the shift is untrusted, but
                # good enough for a key, see contact.TWO_FIT.
                if not touching:
                    self._learns = 3
                if self._learns:
                    self._learns -= 1
                    if not self._learns:
                        limit = calibration.drift_max
                        if abs(misfit - self._seen) <= tolerance:
                            self._drift = min(max(misfit, -limit), limit)
                        self._seen = misfit
                if flags & MISFIT and abs(misfit - self._drift) <= tolerance:
                    flags |= TOO_DARK
        self.flags = flags
