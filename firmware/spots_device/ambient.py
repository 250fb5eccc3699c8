"""Ambient light: detects light whose spectrum does not fit a press, such as a lamp."""

from .decode import LED_OFF, MISFIT, NOT_CALIBRATED, TOUCHING
from .smux import CHANNELS

# Light that fits no press for so long, or light without a touch that differs from what it was by
# so many counts in all, asks for a new dark frame, but not more often than this.
ODD_US = 300_000
ODD_COUNTS = 24
ODD_EVERY_US = 2_000_000


class OddLight:
    """Judges readings since the last dark frame. Allocates nothing."""

    def __init__(self):
        self.restart()

    def restart(self):
        """Begin again: the dark frame is new."""
        self._odd_us = 0
        self._quiet = -1

    def take(self, flags, sums, samples, lasted_us, age_us):
        """Take a reading; return whether the dark frame, of this age, must be measured again."""
        if not self._is_odd(flags, sums, samples):
            self._odd_us = 0
        elif self._odd_us < ODD_US:
            self._odd_us += lasted_us
        else:
            return age_us >= ODD_EVERY_US
        return False

    def _is_odd(self, flags, sums, samples):
        if flags & NOT_CALIBRATED:
            return False  # without a calibration, the spectrum of a press is unknown
        if flags & (TOUCHING | LED_OFF):
            return flags & MISFIT
        light = 0
        for i in range(CHANNELS):
            light += sums[i]
        light //= samples
        if self._quiet < 0:
            self._quiet = light
        return abs(light - self._quiet) > ODD_COUNTS
