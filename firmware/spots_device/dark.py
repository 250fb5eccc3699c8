"""Dark frame and baseline, which are subtracted from each reading.

The dark frame is the count of each channel while the LED is off. The baseline is the count of the
untouched strip while the LED is on, minus the dark frame.

A dark window is four samples with the LED off. Counts are integers, and their rounding error is up
to three times the noise of the light. So the first 16 windows are averaged; then each new window
has the weight 1/8. This average has the noise and the delay of a mean over 16 windows, but needs no
memory for windows. If a window deviates too much from the mean, the ambient light has changed, and
the mean restarts.
"""

from array import array

from micropython import const

from .decode import LED_OFF, LIGHT, MISFIT, NOT_CALIBRATED, SAMPLES, TOUCHING
from .kernel import accumulate
from .smux import CHANNELS

_WINDOW_SAMPLES = const(4)
_WINDOWS = const(16)
_WEIGHT = const(8)  # after the first 16 windows, a window has the weight 1/8
# A dark window takes six samples, so windows must be rare.
_DARK_EVERY_US = const(10_000_000)
_DARK_EVERY_SAMPLES = const(100)
_REQUEST_US = const(2_000_000)  # longest duration of a requested dark frame
_EVERY_MAX_US = const(500_000_000)  # so that the age fits a small integer
# Limit of the chi-squared of a window's six sums. Noise exceeds it in less than one of 1000
# windows. The assumed variance of a sum s is s + 4 counts**2, for the noise of light, converter and
# rounding; the expected sums have the same variance.
_JUMP = const(24)
_JUMP_MAX = const(1 << 12)  # a difference whose square, times 2**4, fits a small integer
_Q = const(12)
_SUMS_SHIFT = const(6)  # from Q12 to sums over `decode.DARK_SAMPLES`
# `_SETTLED_US`: time after a touch before the baseline is tracked again. `_UP` and `_DOWN`: log2 of
# the time constants in readings. Growing light may be a slow finger; fading light cannot.
_SETTLED_US = const(200_000)
_UP = const(10)
_DOWN = const(6)
_POOL_SAMPLES = const(64)
_POOL_SHIFT = const(_Q - 6)  # from Q12 to sums over this number of samples
# Limit of the samples of a reading times the samples of the dark frame, for `kernel.estimate`.
_PRODUCT_MAX = const(256)
# A new dark frame is requested in two cases: a touch does not fit one press for `_ODD_US`, or the
# sum of the counts without a touch has changed by `_ODD_COUNTS`. `_ODD_EVERY_US` is the shortest
# time between two requests.
_ODD_US = const(300_000)
_ODD_COUNTS = const(24)
_ODD_EVERY_US = const(2_000_000)


class Dark:
    """Averages dark windows (four samples with the LED off). `add` allocates nothing.

    Attributes
    ----------
    mean : array of int
        Mean dark counts of the six channels, Q12.
    wanted : bool
        Whether a window must begin as soon as possible; this window restarts the mean.
    age_us, every_us : int
        Time since the last window, and least time between two windows, in us. The age stops at
        `every_us`, so that it cannot overflow.
    exposure_us : int
        Time in us by which each sample increases `age_us`; 0 if the board cannot switch the LED.
    always : bool
        True if single dark samples are taken, even while the strip is touched.
    """

    def __init__(self):
        self.mean = array("i", bytes(4 * CHANNELS))
        self._window = array("i", bytes(4 * CHANNELS))
        self._count = 0  # windows in the mean
        self._taken = 0  # samples in the window
        self._left = 0  # samples until the LED is switched on again
        self._pool_wanted = False
        self.wanted = True
        self.age_us = 0
        self.every_us = _DARK_EVERY_US
        self.exposure_us = 0
        self.always = False

    def schedule(self, exposure_us, dark_every):
        """Set how often dark windows are taken.

        Parameters
        ----------
        exposure_us : int
            Integration time in us; 0 if windows are taken on request only.
        dark_every : int
            Number of samples between two dark samples; such dark samples are taken even during a
            touch. With 0, windows of four samples are taken while the strip is not touched.
        """
        self.exposure_us = exposure_us
        self.always = dark_every > 0
        self.every_us = min(dark_every * exposure_us, _EVERY_MAX_US)
        if not self.always:
            self.every_us = max(_DARK_EVERY_US, _DARK_EVERY_SAMPLES * exposure_us)

    def request(self):
        """If the LED can be switched, take a dark window as soon as possible; restart the mean."""
        self.wanted = self.exposure_us > 0

    def use(self, sums):
        """Use a stored dark frame; return whether `sums` contains one.

        Parameters
        ----------
        sums : sequence of int
            Six sums as the method `sums` returns them; empty or False for no dark frame.
        """
        self.age_us = 0
        for i in range(CHANNELS):
            self.mean[i] = sums[i] << _SUMS_SHIFT if sums else 0
        return bool(sums)

    def request_pool(self):
        """Restart the mean: take 16 dark windows in a row, or as many as fit in two seconds."""
        self.wanted = self._pool_wanted = True

    def begin(self, exposure_us):
        """Begin a series of dark samples of `exposure_us` us each; the LED is already off."""
        if self.wanted:
            windows = 1
            if self._pool_wanted:
                windows = min(max(1, _REQUEST_US // (_WINDOW_SAMPLES * exposure_us)), _WINDOWS)
            self.wanted = self._pool_wanted = False
            self._count = self._taken = 0
            self._left = _WINDOW_SAMPLES * windows
        else:
            self._left = 1 if self.always else _WINDOW_SAMPLES

    def add(self, counts):
        """Add a dark sample (six counts); return whether the series is complete."""
        accumulate(self._window, counts, self._taken)
        self._taken += 1
        if self._taken == _WINDOW_SAMPLES:
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
        """Subtract the dark frame from a sample's six counts, and return the largest result."""
        peak = 0
        for i in range(CHANNELS):
            peak = max(peak, counts[i] - (self.mean[i] >> _Q))
        return peak

    def _pool(self):
        count = self._count
        score = 0
        for i in range(CHANNELS):
            expected = self.mean[i] >> 10
            off = abs(self._window[i] - expected)
            if off < _JUMP_MAX:
                score += (off * off << 4) // (expected + 4)
                if score * count <= (_JUMP << 4) * (count + 1):
                    continue
            count = 0  # the ambient light has changed
            break
        weight = _WEIGHT
        if count < _WINDOWS:
            count += 1
            weight = count
        self._count = count
        for i in range(CHANNELS):
            gap = (self._window[i] << 10) - self.mean[i]
            self.mean[i] += (gap + (weight >> 1)) // weight


class OddLight:
    """Detects changes of the ambient light since the last dark frame. Allocates nothing.

    Parameters
    ----------
    dark : Dark
        The dark frame, which is requested again after a change.
    """

    def __init__(self, dark):
        self._dark = dark
        self.restart()

    def restart(self):
        """Restart the detection after a new dark frame."""
        self._odd_us = 0
        self._level = -1  # sum of the counts without a touch; -1 before the first one

    def take(self, flags, state, lasted_us):
        """Process a reading; if the ambient light has changed, request a new dark frame.

        Parameters
        ----------
        flags : int
            Flag bits of the reading, see the module `decode`.
        state : array of int
            State of the strip, see decode.py.
        lasted_us : int
            Duration of the reading in us.
        """
        if flags & NOT_CALIBRATED:
            return  # without a calibration, the spectrum of a press is unknown
        if flags & (TOUCHING | LED_OFF):
            odd = flags & MISFIT
        else:
            light = state[LIGHT] // state[SAMPLES]
            if self._level < 0:
                self._level = light
            odd = abs(light - self._level) > _ODD_COUNTS
        if not odd:
            self._odd_us = 0
        elif self._odd_us < _ODD_US:
            self._odd_us += lasted_us
        elif self._dark.age_us >= _ODD_EVERY_US:
            self._dark.request()


class Baseline:
    """Tracks the baseline, and computes the sum of dark frame and baseline (`floor`).

    Parameters
    ----------
    dark : Dark
        The dark frame.

    Attributes
    ----------
    floor : array of int
        Sum of dark frame and baseline, as six sums of counts; subtracted from each reading.
    samples : int
        Number of samples in a reading for which `floor` is scaled.
    followed : bool
        Whether the baseline has been measured.
    wanted : bool
        Whether the next reading becomes the baseline, without averaging.
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
        """Scale `floor` for readings of `samples` samples; return the number of samples in `floor`.

        The returned number is a power of 2, at most 64, and within the limits of `kernel.estimate`.
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
        """Update the baseline with a reading that was taken with the LED on; allocates nothing.

        Parameters
        ----------
        sums : array of int
            Six sums of counts over `samples` samples.
        samples : int
            Samples in the reading.
        idle_us : int
            Time since the last touch, in us.
        rests : bool
            True if an object that is not a finger lies on the strip. The reading then becomes
            the baseline.
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
        """Set the baseline to 0."""
        self.followed = False
        for i in range(CHANNELS):
            self._level[i] = 0
        self.update()

    def update(self):
        """Compute `floor` again, after a change of the dark frame or of the baseline."""
        half = 1 << self._shift >> 1
        for i in range(CHANNELS):
            self.floor[i] = self._dark.mean[i] + self._level[i] + half >> self._shift


def follow(rest, floor, sums, samples, dark, shift, up, down):
    """Move the baseline (the counts of the untouched strip) towards a reading.

    Parameters
    ----------
    rest : sequence of int
        The baseline, changed in place: six dark-subtracted counts in Q12.
    floor : sequence of int
        Output: dark frame plus baseline, shifted right by `shift` bits and rounded, as
        `kernel.estimate` subtracts it from readings.
    sums : sequence of int
        Six sums of counts over `samples` samples.
    samples : int
        Samples in the reading.
    dark : sequence of int
        Dark frame: six counts in Q12.
    shift : int
        Right shift from Q12 to the scale of `floor`.
    up, down : int
        The baseline moves by a part of its distance to the reading: by 2**-`up` if the reading is
        higher, else by 2**-`down`.
    """
    half = 1 << shift >> 1
    for i in range(CHANNELS):
        gap = (sums[i] * 4 // samples << 10) - dark[i] - rest[i]
        level = rest[i] + (gap >> (up if gap > 0 else down))
        if level < 0:
            level = 0
        rest[i] = level
        floor[i] = dark[i] + level + half >> shift
