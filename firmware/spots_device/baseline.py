"""The baseline: light of the untouched strip beyond the dark frame, followed while it drifts."""

from array import array

from .decode import DARK_SAMPLES
from .kernel import follow
from .smux import CHANNELS

# Followed from so long after a touch on. Time constants in readings, as powers of 2: light that
# grows may be a finger that comes slowly, light that fades cannot.
SETTLED_US = 200_000
_UP = 10
_DOWN = 6
_Q = 10


class Baseline:
    """Follows the untouched strip, and adds it to the dark frame.

    Parameters
    ----------
    dark : dark.Dark

    Attributes
    ----------
    floor : array of int
        Dark frame and baseline together: what a reading is compared with.
    followed : bool
        Whether there is a baseline.
    wanted : bool
        Whether the next reading becomes the baseline as it is.
    """

    def __init__(self, dark):
        self._dark = dark
        self._level = array("i", bytes(4 * CHANNELS))
        self.followed = False
        self.floor = array("i", bytes(4 * CHANNELS))
        self.wanted = False

    def levels(self):
        """Return the baseline, counted as the dark frame is."""
        return [level >> _Q for level in self._level]

    def follow(self, sums, samples, idle_us, rests):
        """Take a reading with the LED on; allocates nothing.

        Parameters
        ----------
        sums : array of int
            Six sums of counts over `samples` samples.
        samples : int
        idle_us : int
            Time since the last touch.
        rests : bool
            Whether what lies on the strip is no finger.
        """
        if rests or self.wanted:
            self.wanted = False
            up = down = 0
        elif idle_us >= SETTLED_US:
            up = _UP
            down = _DOWN
        else:
            return
        self.followed = True
        follow(self._level, self.floor, sums, samples, self._dark.sums, DARK_SAMPLES, up, down)

    def forget(self):
        """Start from the dark frame alone."""
        self.followed = False
        for i in range(CHANNELS):
            self._level[i] = 0
        self.update()

    def update(self):
        """Use a new dark frame."""
        for i in range(CHANNELS):
            self.floor[i] = self._dark.sums[i] + (self._level[i] >> _Q)
