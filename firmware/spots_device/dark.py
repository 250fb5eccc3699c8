"""What is taken off a reading: the dark frame, and the baseline, light of the untouched strip.

The dark frame is what the sensor counts while the LED is off.

One window of four samples has up to three times the error that the light allows, because counts are
whole. So the frame is the mean of 16 windows, and from then on each further one weighs an eighth:
that is as noisy and as late as the mean of the last 16, and needs none of them. It restarts where a
window does not fit: then the ambient light has changed.
"""

from array import array

from micropython import const

from .decode import LED_OFF, MISFIT, NOT_CALIBRATED, TOUCHING
from .kernel import accumulate, follow
from .smux import CHANNELS

WINDOW_SAMPLES = const(4)
WINDOWS = const(16)
_WEIGHT = const(8)  # of a further window: its part of the mean
# A dark window takes six samples: rare enough that the strip is hardly ever blind.
DARK_EVERY_US = const(10_000_000)
_DARK_EVERY_SAMPLES = const(100)
_REQUEST_US = const(2_000_000)  # what a pool on request may take
_EVERY_MAX_US = const(500_000_000)  # so that the age fits a small integer
# A window whose six sums differ from those expected, squared and over their variance, by more than
# this in all: chance does that less than once in 1000 windows. The variance of a sum s is taken as
# s + 4 counts**2, for the noise of light, converter and rounding; of the expected one as well.
_JUMP = const(24)
_JUMP_MAX = const(1 << 12)  # a difference whose square, times 2**4, fits a small integer
_Q = const(12)
_SUMS_SHIFT = const(6)  # from Q12 to sums over `decode.DARK_SAMPLES`
# Followed from so long after a touch on. Time constants in readings, as powers of 2: light that
# grows may be a finger that comes slowly, light that fades cannot.
_SETTLED_US = const(200_000)
_UP = const(10)
_DOWN = const(6)
_POOL_SAMPLES = const(64)
_POOL_SHIFT = const(_Q - 6)  # from Q12 to sums over so many
# Times the samples of a reading: keeps the sums of `kernel.estimate` below 2**24.
_PRODUCT_MAX = const(256)
# Light that fits no press for so long, or light without a touch that differs from what it was by
# so many counts in all, asks for a new dark frame, but not more often than this.
_ODD_US = const(300_000)
_ODD_COUNTS = const(24)
_ODD_EVERY_US = const(2_000_000)


class Dark:
    """Pools dark windows. `add` allocates nothing.

    Attributes
    ----------
    mean : array of int
        Six mean dark counts, Q12.
    wanted : bool
        Whether a window must begin as soon as possible, which restarts the pool.
    age_us, every_us : int
        Time since the last window, and from when on the next one may begin. The age stops there,
        so that it never overflows.
    exposure_us : int
        Which each sample adds to the age; 0 where the board cannot switch the LED.
    always : bool
        Whether single dark samples are taken even while the strip is touched.
    """

    def __init__(self):
        self.mean = array("i", bytes(4 * CHANNELS))
        self._window = array("i", bytes(4 * CHANNELS))
        self._count = 0  # windows in the pool
        self._taken = 0  # samples in the window
        self._left = 0  # samples until the LED is switched on again
        self._pool_wanted = False
        self.wanted = True
        self.age_us = 0
        self.every_us = DARK_EVERY_US
        self.exposure_us = 0
        self.always = False

    def schedule(self, exposure_us, dark_every):
        """Set how often windows are taken.

        Parameters
        ----------
        exposure_us : int
            0 for none but on request.
        dark_every : int
            One dark sample in so many, also while touched; 0 for windows on the untouched strip.
        """
        self.exposure_us = exposure_us
        self.always = dark_every > 0
        self.every_us = min(dark_every * exposure_us, _EVERY_MAX_US)
        if not self.always:
            self.every_us = max(DARK_EVERY_US, _DARK_EVERY_SAMPLES * exposure_us)

    def request(self):
        """Restart the pool with one window, as soon as possible, where the LED can be switched."""
        self.wanted = self.exposure_us > 0

    def use(self, sums):
        """Use a dark frame as `sums` returns it, or none; return whether there is one."""
        self.age_us = 0
        for i in range(CHANNELS):
            self.mean[i] = sums[i] << _SUMS_SHIFT if sums else 0
        return bool(sums)

    def request_pool(self):
        """Restart the pool with all windows, or as many as fit into two seconds."""
        self.wanted = self._pool_wanted = True

    def begin(self, exposure_us):
        """Begin to take samples: the LED is off."""
        if self.wanted:
            windows = 1
            if self._pool_wanted:
                windows = min(max(1, _REQUEST_US // (WINDOW_SAMPLES * exposure_us)), WINDOWS)
            self.wanted = self._pool_wanted = False
            self._count = self._taken = 0
            self._left = WINDOW_SAMPLES * windows
        else:
            self._left = 1 if self.always else WINDOW_SAMPLES

    def add(self, counts):
        """Add a dark sample; return whether there are enough of them."""
        accumulate(self._window, counts, self._taken)
        self._taken += 1
        if self._taken == WINDOW_SAMPLES:
            self._taken = 0
            self._pool()
        self._left -= 1
        if self._left > 0:
            return False
        self.age_us = 0
        return True

    def sums(self):
        """Return the dark frame as six sums over `decode.DARK_SAMPLES` samples, rounded."""
        return [mean + (1 << _SUMS_SHIFT - 1) >> _SUMS_SHIFT for mean in self.mean]

    def peak(self, counts):
        """Return the highest count of a sample's channels, after subtracting the dark counts."""
        peak = 0
        for i in range(CHANNELS):
            peak = max(peak, counts[i] - (self.mean[i] >> _Q))
        return peak

    def _pool(self):
        if self._is_jump():
            self._count = 0
        weight = _WEIGHT
        if self._count < WINDOWS:
            self._count += 1
            weight = self._count
        for i in range(CHANNELS):
            gap = (self._window[i] << 10) - self.mean[i]
            self.mean[i] += (gap + (weight >> 1)) // weight

    def _is_jump(self):
        score = 0
        for i in range(CHANNELS):
            expected = self.mean[i] >> 10
            off = abs(self._window[i] - expected)
            if off >= _JUMP_MAX:
                return True
            score += (off * off << 4) // (expected + 4)
            if score * self._count > (_JUMP << 4) * (self._count + 1):
                return True
        return False


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
        elif self._odd_us < _ODD_US:
            self._odd_us += lasted_us
        else:
            return age_us >= _ODD_EVERY_US
        return False

    def _is_odd(self, flags, sums, samples):
        if flags & NOT_CALIBRATED:
            return False  # nobody knows what a press looks like
        if flags & (TOUCHING | LED_OFF):
            return flags & MISFIT
        light = 0
        for i in range(CHANNELS):
            light += sums[i]
        light //= samples
        if self._quiet < 0:
            self._quiet = light
        return abs(light - self._quiet) > _ODD_COUNTS


class Baseline:
    """Follows the untouched strip, and adds it to the dark frame.

    Parameters
    ----------
    dark : Dark

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
