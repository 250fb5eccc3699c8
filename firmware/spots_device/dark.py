"""The dark frame: what the sensor counts while the LED is off, and when to measure it again."""

from array import array

from .decode import DARK_SAMPLES
from .kernel import accumulate
from .smux import CHANNELS

# A dark window takes six samples: rare enough that the strip is hardly ever blind.
DARK_EVERY_US = 10_000_000
DARK_EVERY_SAMPLES = 100


class Dark:
    """Sums of the last dark window.

    Attributes
    ----------
    sums : array of int
        Six sums of counts over `DARK_SAMPLES` samples.
    wanted : bool
        Whether a window must begin as soon as possible.
    age_us, every_us : int
        Time since the last window, and from when on the next one may begin. The age stops there,
        so that it never overflows.
    """

    def __init__(self):
        self.sums = array("i", bytes(4 * CHANNELS))
        self._window = array("i", bytes(4 * CHANNELS))
        self._taken = 0
        self.wanted = True
        self.age_us = 0
        self.every_us = DARK_EVERY_US

    def restart(self, exposure_us):
        """Discard the frame: the sensor has a new exposure, gain or LED current."""
        self.wanted = True
        self.every_us = max(DARK_EVERY_US, DARK_EVERY_SAMPLES * exposure_us)

    def begin(self):
        """Begin a window."""
        self._taken = 0

    def add(self, counts):
        """Add a dark sample to the window; allocates nothing."""
        accumulate(self._window, counts, self._taken)
        self._taken += 1

    def is_complete(self):
        """Return whether the window has all its samples."""
        return self._taken == DARK_SAMPLES

    def end(self):
        """Use the window."""
        for i in range(CHANNELS):
            self.sums[i] = self._window[i]
        self.wanted = False
        self.age_us = 0

    def peak(self, counts):
        """Return the brightest channel of a sample without its dark count."""
        peak = 0
        for i in range(CHANNELS):
            peak = max(peak, counts[i] - self.sums[i] // DARK_SAMPLES)
        return peak
