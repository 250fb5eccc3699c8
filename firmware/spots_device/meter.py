"""Measures the time that the loop takes for a sample, and predicts the rate of readings."""

from micropython import const

_SKIPPED = const(2)  # passes after a command are late
_COUNTED = const(16)
_LONGEST_US = const(1 << 24)  # so that their sum fits a small integer


class Meter:
    """The mean time of the loop's passes that take a sample. `add` allocates nothing.

    Attributes
    ----------
    busy_us : int
        That time, without sleep; 0 as long as it is not known.
    """

    def __init__(self):
        self.busy_us = 0
        self.restart()

    def restart(self):
        """Measure again; `busy_us` stays until that is done."""
        self._sum_us = 0
        self._passes = -_SKIPPED

    def add(self, pass_us):
        """Take a pass; return whether there are enough."""
        if self._passes >= 0:
            self._sum_us += min(pass_us, _LONGEST_US)
        self._passes += 1
        if self._passes < _COUNTED:
            return False
        self.busy_us = self._sum_us // _COUNTED
        self.restart()
        return True

    def rate_mHz(self, exposure_us, average):
        """Return how many readings come in 1000 s: as the sensor samples, or the loop can."""
        return 1_000_000_000 // (max(exposure_us, self.busy_us) * average)
