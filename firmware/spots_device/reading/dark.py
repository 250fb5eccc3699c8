"""Dark frame and baseline, which are subtracted from each reading.

The dark frame is the count of each channel while the LED is off. The baseline is the count of the
untouched strip while the LED is on, minus the dark frame: light that crosses between the guides
without a press, for example at dust.

A dark window is four samples with the LED off. Counts are integers, and their rounding error is up
to three times the noise of the light. So the first 16 windows are averaged; then each new window
has the weight 1/8. This average has the noise and the delay of a mean over 16 windows, but needs no
memory for windows. If a window deviates too much from the mean, the ambient light has changed, and
the mean restarts.

Ambient light that has changed may change again: a hand shades the strip, or leaves move in the sun.
So for some time after a change, single dark samples are taken often, also during a touch, and one
as soon as the light of a reading cannot be explained. The mean then includes only a few samples.

The baseline starts with the value of the calibration. It follows the difference between a dark
window and the lit samples directly before and after it. Ambient light, and a shadow on it, is the
same in all of these samples, so it never enters the baseline.
"""

from array import array

from .. import const
from ..sensor.smux import CHANNELS
from . import decode as d

IDLE_US = 1_000_000  # time without a touch before the LED may be switched off

_WINDOW_SAMPLES = const(4)
_WINDOWS = const(16)
_FULL = const(64)  # samples of 16 windows
_WEIGHT = const(32)  # after these, a sample has the weight 1/32, and so a window 1/8
# A dark window and the switching of the LED take six samples, so windows must be rare.
_DARK_EVERY_US = const(10_000_000)
_DARK_EVERY_SAMPLES = const(100)
_REQUEST_US = const(2_000_000)  # longest duration of a requested dark frame
_EVERY_MAX_US = const(500_000_000)  # so that the age fits a small integer
# While the ambient light changes: samples between two dark samples; the same if the light cannot be
# explained, without a touch and during one; dark samples until the light counts as constant.
_CHANGING_EVERY = const(20)
_ODD_EVERY = const(4)
_ODD_TOUCH_EVERY = const(8)
_CHANGING = const(80)
# While the ambient light is constant, a hand may still shade it: if the mean has at least this
# number of counts in all channels, a touch has a dark sample, at most this often.
_SHADE_LEAST = const(12)
_SHADE_EVERY_US = const(2_000_000)
_CHANGING_SAMPLES = const(8)  # in the mean
# The sums of two dark samples differ if the difference is more than this number of counts, plus a
# share of the sum.
_CHANGE = const(8)
_CHANGE_SHIFT = const(5)
# The light of a lamp can flicker. A window shows no change if the largest difference of its samples
# is above this share of the change.
_FLICKER_SHIFT = const(3)
# A window differs too much from the mean if the chi-squared of its six sums is above this limit.
# Noise exceeds the limit in less than one of 1000 windows. The assumed variance of a sum s over n
# samples is s/16 + n counts**2, for the noise of light, converter and rounding.
JUMP = 24
_JUMP_MAX = const(1 << 12)  # the square of a smaller difference, times 2**4, fits a small integer
_Q = const(12)
_SUMS_SHIFT = const(6)  # from Q12 to sums over `decode.DARK_SAMPLES`
_POOL_SAMPLES = const(64)  # samples of 16 windows
_POOL_SHIFT = const(_Q - 6)  # from Q12 to sums over this number of samples
# Limit of the samples of a reading times the samples of the dark frame, for `kernel.estimate`.
_PRODUCT_MAX = const(256)
# The baseline changes if the chi-squared of the mean difference is above `_JUMP`. So noise never
# changes it, and a strip without such light gets none.
_SETTLED_US = const(200_000)  # time without a touch before the baseline may follow
_FAR = const(1 << 20)  # largest summand of a chi-squared, Q4


class Dark:
    """Averages dark windows to a dark frame. `add` allocates nothing.

    `kernel.process` decides when the next dark window begins: it counts the age of the dark frame
    and detects changes of the ambient light.
    """

    def __init__(self, state):
        self.state = state
        self.mean = memoryview(state)[d.DARK : d.DARK + CHANNELS]  # counts, Q12
        self.window = array("i", bytes(4 * CHANNELS))  # sums over the samples of the last window
        self.count = 0  # samples in the mean, until its weight is constant
        self._taken = 0  # samples in the window
        self._least = self._most = 0  # sums of all channels in the window
        self._last = 0  # sum of all channels in the last single sample
        self._exposure_us = self._every = 0
        self.changing = 0  # dark samples until the ambient light counts as constant
        self._left = 0  # samples until the LED is switched on again
        self._pool_wanted = False
        state[d.WANTED] = 1
        state[d.IDLE_MIN_US] = IDLE_US

    def schedule(self, exposure_us, dark_every):
        """Take a dark sample every `dark_every` samples, even during a touch.

        With 0, dark windows of four samples are taken while the strip is not touched. With an
        `exposure_us` of 0 the LED cannot be switched: dark windows are taken on request only.
        """
        self.state[d.AGE_STEP_US] = self._exposure_us = exposure_us
        self._every = dark_every
        self._pace()

    def _pace(self):
        state = self.state
        exposure_us = self._exposure_us
        every = self._every
        state[d.SHADE_US] = _EVERY_MAX_US
        if self._light() >= _SHADE_LEAST:
            state[d.SHADE_US] = max(_SHADE_EVERY_US, _DARK_EVERY_SAMPLES * exposure_us)
        if self.changing and (not every or every > _CHANGING_EVERY):
            every = _CHANGING_EVERY
        state[d.EVERY_US] = min(every * exposure_us, _EVERY_MAX_US)
        state[d.IDLE_MIN_US] = 0
        if not every:
            state[d.EVERY_US] = max(_DARK_EVERY_US, _DARK_EVERY_SAMPLES * exposure_us)
            state[d.IDLE_MIN_US] = IDLE_US

    def is_due(self):
        """Return whether the last reading needs a dark sample, while the ambient light changes."""
        state = self.state
        every = _ODD_EVERY
        if state[d.TOUCHED]:
            every = _ODD_TOUCH_EVERY
            # If there was none in this touch yet: the hand that presses may shade the strip.
            if every * self._exposure_us <= state[d.BEGUN_US] < state[d.AGE_US]:
                return True
        return state[d.ODD_US] > 0 and state[d.AGE_US] >= every * self._exposure_us

    def request(self):
        """Restart the mean of the dark windows with a window as soon as possible.

        No window is requested if the LED cannot be switched.
        """
        self.state[d.WANTED] = 1 if self.state[d.AGE_STEP_US] else 0

    def use(self, sums):
        """Use six stored sums, as `sums` returns them; return False if there are none."""
        self.state[d.AGE_US] = 0
        for i in range(CHANNELS):
            self.mean[i] = sums[i] << _SUMS_SHIFT if sums else 0
        return bool(sums)

    def request_pool(self):
        """Restart the mean of the dark windows: request 16 in a row, or as many as fit in 2 s."""
        self._pool_wanted = True
        self.state[d.WANTED] = 1

    def begin(self, exposure_us):
        """Begin a series of dark samples of `exposure_us` us each; the LED must be off already.

        The series is one sample, one dark window (four samples), or all windows of `request_pool`.
        Returns whether it is at least one window.
        """
        if self.state[d.WANTED]:
            windows = 1
            if self._pool_wanted:
                windows = min(max(1, _REQUEST_US // (_WINDOW_SAMPLES * exposure_us)), _WINDOWS)
            self._pool_wanted = False
            if self.state[d.WANTED] != d.CHECK:
                self.count = 0
            self.state[d.WANTED] = self._taken = 0
            self._left = _WINDOW_SAMPLES * windows
        else:
            self._left = 1
            if self.state[d.IDLE_MIN_US] and not self.state[d.TOUCHED]:
                self._left = _WINDOW_SAMPLES
        return self._left > 1

    def add(self, counts):
        """Add a dark sample (six counts); return whether the series of `begin` is complete."""
        total = 0
        for i in range(CHANNELS):
            total += counts[i]
            self.window[i] = counts[i] + (self.window[i] if self._taken else 0)
        if not self._taken:
            self._least = self._most = total
        self._least = min(self._least, total)
        self._most = max(self._most, total)
        self._taken += 1
        self._left -= 1
        if self._taken == _WINDOW_SAMPLES or not self._left:
            if self._is_shaded():
                self._left = _WINDOW_SAMPLES  # a shadow, or a lamp that flickers: a window decides
            else:
                self._pool(self._taken)
            self._taken = 0
        if self._left > 0:
            return False
        self.state[d.AGE_US] = 0
        return True

    def _is_shaded(self):
        # Whether a single sample differs from the mean, although the light counts as constant.
        if self._taken > 1 or not self.state[d.IDLE_MIN_US]:
            return False
        return self._has_moved(self._light())

    def _has_moved(self, light):
        return abs(self._most - light) > _CHANGE + (light >> _CHANGE_SHIFT)

    def _light(self):
        light = 0
        for mean in self.mean:
            light += mean + (1 << _Q - 1) >> _Q
        return light

    def sums(self):
        """Return each channel's mean dark count, times `decode.DARK_SAMPLES`, rounded."""
        return [mean + (1 << _SUMS_SHIFT - 1) >> _SUMS_SHIFT for mean in self.mean]

    def peak(self, counts):
        """Subtract the dark frame from a sample's six counts; return the largest difference."""
        peak = 0
        for i in range(CHANNELS):
            peak = max(peak, counts[i] - (self.mean[i] >> _Q))
        return peak

    def _pool(self, samples):
        shift = _Q if samples == 1 else _Q - 2
        count = self.count
        score = change = 0
        for i in range(CHANNELS):
            expected = self.mean[i] >> shift
            change += self.window[i] - expected
            score += chi2(self.window[i] - expected << 8, (expected >> 4) + samples)
        if score * count > (JUMP << 4) * (count + samples):
            count = 0
            if abs(change) >> _FLICKER_SHIFT >= self._most - self._least:
                self.changing = _CHANGING
        elif self.changing:
            self.changing -= 1
            # The mean may have followed the light, see ambient.py.
            if self._has_moved(self._last):
                self.changing = _CHANGING
            if samples == 1 and self._has_moved(self._light()):
                count = 0
        self._last = self._most
        full = _CHANGING_SAMPLES if self.changing else _FULL
        if count < full:
            count += samples
            weight = max(count // samples, 1)
        else:
            weight = min(full, _WEIGHT) // samples
        self.count = count
        for i in range(CHANNELS):
            gap = (self.window[i] << shift) - self.mean[i]
            self.mean[i] += (gap + (weight >> 1)) // weight
        self._pace()


class Baseline:
    """Tracks the baseline, which is the light of the untouched strip minus the dark frame."""

    def __init__(self, dark):
        self._dark = dark
        self._state = dark.state
        view = memoryview(dark.state)
        self._level = view[d.BASELINE : d.BASELINE + CHANNELS]  # counts, Q12
        # Sums of dark frame and baseline; subtracted from each reading of `samples` samples.
        self.floor = view[d.FLOOR : d.FLOOR + CHANNELS]
        self._stick = view[d.STICK : d.STICK + CHANNELS]
        self._state[d.SHIFT] = _Q
        self.samples = 0
        self.left = 0  # lit samples that `after` still needs; with 0 it must not be called
        # All sums are over four samples, as those of a dark window.
        self._before = array("i", bytes(4 * CHANNELS))
        self._after = array("i", bytes(4 * CHANNELS))
        self._gap = array("i", bytes(4 * CHANNELS))  # mean of lit minus floor, Q8
        self._count = 0  # windows in this mean

    def sums(self):
        """Return the baseline: for each channel a sum over `decode.DARK_SAMPLES` samples."""
        return [level >> _POOL_SHIFT for level in self._level]

    def rescale(self, samples):
        """Scale `floor` to sums over n samples, for readings of `samples` samples; return n.

        n is the largest power of 2 for which n <= 64 and ``n * samples <= 256``; see
        `decode.Decode.scale`.
        """
        self.samples = samples
        dark_samples = _POOL_SAMPLES
        shift = _POOL_SHIFT
        while dark_samples * samples > _PRODUCT_MAX:
            dark_samples >>= 1
            shift += 1
        self._state[d.SHIFT] = shift
        self.update()
        return dark_samples

    def start(self, calibration, exposure_us):
        """Start with the baseline of a `calibration.Calibration`, or with 0 for None.

        The line ``rest`` of the calibration is scaled to the exposure `exposure_us`.
        """
        for i in range(CHANNELS):
            level = 0
            if calibration is not None and calibration.baseline:
                ratio = exposure_us / calibration.conditions.exposure_us
                level = min(int(calibration.baseline[i] * ratio), d.COUNT_MAX_Q12 >> _POOL_SHIFT)
            self._level[i] = level << _POOL_SHIFT
        self.unstick()
        self._restart()

    def take(self):
        """Use the light of the present reading as the baseline."""
        state = self._state
        for i in range(CHANNELS):
            level = (state[d.SUMS + i] * 4 // state[d.SAMPLES] << 10) - self._dark.mean[i]
            self._level[i] = max(level, 0)
        self.unstick()
        self._restart()

    def unstick(self):
        """Forget the last touch and the light that sticks, see sticking.py."""
        self._state[d.STUCK] = self._state[d.PEAK] = self._state[d.PEAK_LIGHT] = 0
        for i in range(CHANNELS):
            self._stick[i] = 0

    def update(self):
        """Compute `floor` again; must be called after a change of dark frame or baseline."""
        shift = self._state[d.SHIFT]
        half = 1 << shift >> 1
        for i in range(CHANNELS):
            floor = self._dark.mean[i] + self._level[i] + half
            if self._state[d.STUCK] >= d.STUCK_LEAST:
                floor += self._stick[i]
            self.floor[i] = floor >> shift

    # The three methods below allocate nothing.

    def before(self):
        """Store the light before a dark window, if the strip has not been touched for a while."""
        state = self._state
        self.left = 0
        if (
            state[d.AGE_STEP_US]  # else a person switches the LED
            and state[d.IDLE_US] >= _SETTLED_US
            and not state[d.TAKEN]
            and not state[d.FLAGS] & (d.SATURATED | d.NOT_CALIBRATED | d.LED_OFF)
        ):
            for i in range(CHANNELS):
                self._before[i] = state[d.SUMS + i] * 4 // state[d.SAMPLES]
                self._after[i] = 0
            self.left = _WINDOW_SAMPLES

    def after(self, counts, complete):
        """Add a lit sample after a dark window; return whether no further sample is needed.

        `complete` means that the sample has completed a reading; only its flags show a touch.
        """
        if complete and self._state[d.FLAGS] & (d.TOUCHING | d.SATURATED):
            self.left = 0
            return True
        if self.left == 1 and not complete:
            return False
        for i in range(CHANNELS):
            self._after[i] += counts[i]
        self.left -= 1
        if self.left:
            return False
        if self._is_steady():
            self._follow_gap()
        return True

    def _is_steady(self):
        # The ambient light must not have changed during the window.
        score = 0
        for i in range(CHANNELS):
            after = self._after[i]
            score += chi2(self._before[i] - after << 8, 5 * _variance(after))
        return score <= JUMP << 4

    def _follow_gap(self):
        count = self._count
        fits = differs = 0
        for i in range(CHANNELS):
            fits += chi2(self._off(i) - self._gap[i], self._spread(i))
        if fits * count > (JUMP << 4) * (count + 1):
            count = 0
        if count < _WINDOWS:
            count += 1
        self._count = count
        for i in range(CHANNELS):
            gap = self._gap[i] if count > 1 else 0
            self._gap[i] = gap + (self._off(i) - gap) // count
            differs += chi2(self._gap[i], self._spread(i))
        if differs * count > JUMP << 4:
            for i in range(CHANNELS):
                level = self._level[i] + (self._gap[i] << 2)
                self._level[i] = min(max(level, 0), d.COUNT_MAX_Q12)
            self._restart()

    def _off(self, i):
        lit = self._before[i] + self._after[i] << 7
        return lit - (self._dark.window[i] << 8) - (self._level[i] + self._stick[i] >> 2)

    def _spread(self, i):
        # The light before the window is that of a single sample, times four.
        return (9 * _variance(self._after[i]) >> 2) + 1

    def _restart(self):
        self.left = self._count = 0
        self.update()


def _variance(total):
    # Assumed variance of a sum of counts over four samples: converter, rounding, light.
    return (total >> 4) + 4


def chi2(off, variance):
    """Return ``off**2 / variance``, Q4, limited: the sum of a few fits 31 bits.

    `off` is a difference of counts, Q8; its variance in counts**2 is at least 1.
    """
    off = abs(off)
    if off < 1 << 14:
        off >>= 4
        return (off * off << 4) // (variance << 8)
    off >>= 8
    if off >= _JUMP_MAX:
        return _FAR
    return min((off * off << 4) // variance, _FAR)
