"""The baseline: light of the untouched strip beyond the dark frame, followed while it drifts."""

from array import array

from micropython import const

from .kernel import follow
from .smux import CHANNELS

# Followed from so long after a touch on. Time constants in readings, as powers of 2: light that
# grows may be a finger that comes slowly, light that fades cannot.
_SETTLED_US = const(200_000)
_UP = const(10)
_DOWN = const(6)
_Q = const(12)
_POOL_SAMPLES = const(64)
_POOL_SHIFT = const(_Q - 6)  # from Q12 to sums over so many
# Times the samples of a reading: keeps the sums of `kernel.estimate` below 2**24.
_PRODUCT_MAX = const(256)


class Baseline:
    """Follows the untouched strip, and adds it to the dark frame.

    Parameters
    ----------
    dark : dark.Dark

    Attributes
    ----------
    floor : array of int
        Dark frame and baseline together, as six sums: what is taken off a reading.
    samples : int
        Samples of the readings that `floor` is scaled for.
    followed : bool
        Whether there is a baseline.
    wanted : bool
        Whether the next reading becomes the baseline as it is.
    """

    def __init__(self, dark):
        self._dark = dark
        self._level = array("i", bytes(4 * CHANNELS))  # counts, Q12
        self._shift = _Q
        self.samples = 0
        self.followed = False
        self.floor = array("i", bytes(4 * CHANNELS))
        self.wanted = False

    def sums(self):
        """Return the baseline as six sums over `decode.DARK_SAMPLES` samples."""
        return [level >> _POOL_SHIFT for level in self._level]

    def rescale(self, samples):
        """Scale `floor` for readings of so many samples; return over how many samples it is.

        That is a power of 2: as many as the pool has, if the sums of `kernel.estimate` allow it.
        """
        self.samples = samples
        dark_samples = _POOL_SAMPLES
        self._shift = _POOL_SHIFT
        while dark_samples * samples > _PRODUCT_MAX:
            dark_samples >>= 1
            self._shift += 1
        self.update()
        return dark_samples

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
        elif idle_us >= _SETTLED_US:
            up = _UP
            down = _DOWN
        else:
            return
        self.followed = True
        follow(self._level, self.floor, sums, samples, self._dark.mean, self._shift, up, down)

    def forget(self):
        """Start from the dark frame alone."""
        self.followed = False
        for i in range(CHANNELS):
            self._level[i] = 0
        self.update()

    def update(self):
        """Use a new dark frame."""
        half = 1 << self._shift >> 1
        for i in range(CHANNELS):
            self.floor[i] = self._dark.mean[i] + self._level[i] + half >> self._shift
