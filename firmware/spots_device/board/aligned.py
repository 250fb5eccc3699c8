"""Several strips on a board: which one is next, and accurate times of samples of late polls.

Only a board with several strips gets this module.

A poll asks the sensor for a new sample. Polls may be late, because the loop may be busy with
another strip. So a poll only limits the time at which the sample ended. A poll that finds the
sample gives an upper limit; a poll that is too early gives a lower limit. `AlignedPacing` combines
the limits of all polls: the next sample ends within `_end` +- `_half`.

`_half` grows with each sample by the uncertainty of the period. If it becomes too large, the next
poll bisects: it is scheduled exactly at `_end`, and its result halves `_half`. All other polls are
scheduled after the latest possible end, so they find the sample even if they are late.

In 15 samples, one or two polls bisect. `Turns` gives these polls priority over the work for other
strips. At the first start, the period is uncertain by 6 %. One second later, the
times are accurate to 20 us for exposures of 5 to 10 ms. Integers only; allocates nothing.
"""

import gc

from .. import const
from ..sensor.pacing import BRIEF_US, LATCH_US, LONG_US, Pacing
from .strip_app import StripApp

_Q = const(8)  # fraction bits of times relative to `_end`
_FINE = const(2_048)  # 8 us, Q8: with a larger `_half`, the next poll bisects
# After an early poll, polls within the same sample bisect until `_half` is at most 300 us (Q8).
_COARSE = const(300 << 8)
_MARGIN_US = const(12)  # a poll that does not bisect is this much after the latest possible end
# The period is computed from the ends of two samples, about this far apart: it follows a drift.
_SPAN_US = const(2_000_000)
_SPAN_MAX_US = const(4_000_000)  # more would exceed 31 bits in Q8
_SHARE = const(12)  # a measurement of the period is valid if its error is below 1/4096
# More bisections in a row with the same result are improbable: the true end may be outside the
# limits, for example after a jump of the period.
_RUN = const(4)
# The loop polls the strip with the earliest deadline next. To give a strip priority, the following
# times are subtracted from its deadline.
# For a strip whose sample times are unknown.
_UNKNOWN_US = const(2_500)
# For a strip whose next poll bisects, so that it must be on time: 128 times the error of its sample
# times, at most this value times the number of other strips. The value is the time to process a
# sample.
_AHEAD_US = const(2_500)
# For a strip with unknown sample times after a poll that was too early; the second value only if
# the last poll of the loop was of this strip. Without it, two such strips would be polled in turn,
# and the polls of each strip would be too far apart.
_PUNCTUAL_US = const(500)
_STAYS_US = const(4_000)
_FAR_US = const(1 << 29)


def open_strips(board, configs, open_sensor):
    """Return the strips of a board as a tuple; the arguments are those of `app.Board`."""
    strips = []
    for own in configs:
        gc.collect()  # so that the objects of each strip do not lie between garbage
        config = type("Config", (), own)
        sensor = open_sensor(config, board.clock)
        sensor.pacing = AlignedPacing(board.clock)
        if hasattr(config, "MUX_CHANNEL"):
            from ..sensor.multiplexer import connect

            connect(sensor, config.MUX_CHANNEL)
        strips.append(StripApp(board, len(strips), config, sensor))
    return tuple(strips)


class Turns:
    """Chooses the strip of a board with several strips whose sample the loop waits for.

    Parameters
    ----------
    strips : tuple of strip_app.StripApp
        The strips; each has an `AlignedPacing`.
    clock : object
        ``ticks_diff`` as in MicroPython's ``time``.
    """

    def __init__(self, strips, clock):
        self._strips = strips
        self._last = strips[0]
        self._diff = clock.ticks_diff
        self._ahead_us = _AHEAD_US * (len(strips) - 1)

    def next(self, now):
        """Return the strip to poll next: the same again if all are lost. Allocates nothing."""
        chosen = self._last
        least_us = _FAR_US
        i = 0
        while i < len(self._strips):  # an iterator would need a larger call frame, see strip.py
            left_us = self._left_us(self._strips[i], now)
            if left_us < least_us:
                chosen = self._strips[i]
                least_us = left_us
            i += 1
        self._last = chosen
        return chosen

    def _left_us(self, strip, now):
        if strip.reconnect.lost:
            return _FAR_US
        lead_us = strip.pacing.lead_us(self._ahead_us, strip is self._last)
        return self._diff(strip.pacing.due, now) - lead_us


class AlignedPacing(Pacing):
    """Tracks the sample clock of a sensor whose polls are often late; see `pacing.Pacing`.

    It computes the time of each sample in the FIFO, even if the loop reads the FIFO late. Without a
    FIFO, samples are lost while the loop stalls, as with `Pacing`.
    """

    def start(self, now, period_us):
        Pacing.start(self, now, period_us)
        self._exact = self._chip_us << _Q  # estimate of the period, Q8 us
        # Largest error of `_exact`, Q8 us: 1/16 of the period, or 1/256 if the error of the
        # oscillator was measured before.
        self._unsure = period_us if self._off else period_us << 4
        # The oscillator drifts: `_unsure` remains at least 30 ppm of the period.
        self._drift = (period_us >> 7) + 1
        self._half = 0  # Q8 us
        self._run = 0  # bisections with the same result: positive if they found the sample

    def lead_us(self, most_us, stays):
        """Return the priority of the next poll, as a time to subtract from its deadline.

        It is at most `most_us` if the sample times are known. `stays` is whether the last poll of
        the loop was of this strip.
        """
        if self._locked:
            return min(self._half >> 1, most_us) if self._half > _FINE else 0
        if not self._was_early:
            return _UNKNOWN_US
        return _UNKNOWN_US + _PUNCTUAL_US + (_STAYS_US if stays else 0)

    def early(self, now):
        Pacing.early(self, now)
        if self._locked:
            low = (self._diff(now, self._end) + LATCH_US << _Q) - self._fraction
            if low > -self._half:
                self._bound(low, 1)
                self._aim(_COARSE)

    def held(self, before, after, samples):
        if not self._locked:
            # An estimate of the end, from the time of the newest sample.
            before = self._add(before, (1 - samples) * self._chip_us)
            self._count(before, 1)
            if samples > 1:
                self._was_early = False
                self.slack_us = self._chip_us
                self.due = before
                return before
            self._lock(before)
        elif samples == 1:
            high = (self._diff(before, self._end) + LATCH_US << _Q) - self._fraction
            if self._half > self._exact >> 1:
                self._lock(before)
            elif high < self._half and self._diff(after, before) < BRIEF_US:
                self._bound(-high, -1)
        end = self._end
        self._advance()
        return end

    def skip(self, samples):
        for _ in range(samples):
            if self._locked:
                self._advance()
            else:
                self.due = self._add(self.due, self._chip_us)
                self._count(self.due, 1)
        return self._chip_us

    def _doubt(self, before, after):
        end = Pacing._doubt(self, before, after)
        if self._locked:
            self._lock(before, self.slack_us)
            self._advance()
        return end

    def _advance(self):
        """Predict the end of the next sample (`_end`, `_half`), and schedule the poll for it."""
        self._was_early = False
        self.slack_us = self._half >> _Q - 1
        part = self._fraction + self._exact
        self._end = self._add(self._end, part >> _Q)
        self._fraction = part & 255
        self._half += self._unsure
        self._samples += 1
        self._aim(_FINE)

    def _aim(self, bisected):
        # The chip latches its data LATCH_US after the beginning of the poll.
        shift_us = -LATCH_US
        if self._half <= bisected:
            shift_us += (self._half >> _Q) + _MARGIN_US
        self.due = self._add(self._end, shift_us)

    def _lock(self, now, width_us=0):
        """Restart the tracking at a sample that ended at most `width_us` before the poll at `now`.

        If `width_us` is 0, it is set to one period, or to the time since the preceding poll if that
        poll was too early and this time is shorter.
        """
        if not width_us:
            width_us = self._chip_us
            if self._was_early:
                width_us = min(width_us, self._diff(now, self._early))
        self._end = self._add(now, LATCH_US - (width_us >> 1))
        self._fraction = self._run = 0
        self._half = width_us << _Q - 1
        self._locked = True
        self._begin_span(0)

    def _bound(self, low, sign):
        # The sample ends after `low` (Q8 us, relative to `_end`). With the sign -1, `low` and the
        # limits here are mirrored at `_end`: the sample ended before `-low`.
        high = self._half
        if low > high:
            self._widen(low - high)
            high = low + low - high
        if 2 * low > -self._half:
            run = min(sign * self._run, 0) - 1
            self._run = sign * run
            if run < -_RUN:
                self._widen(0)
                high += high - low
        if sign > 0:
            self._limit(low, high)
        else:
            self._limit(-high, -low)

    def _widen(self, excess):
        # Increase the uncertainty of the period. Called if the limits contradict each other by
        # `excess` (Q8 us), or if too many bisections in a row had the same result.
        excess //= max(1, self._samples)
        self._unsure = min(2 * self._unsure + excess, self._exact >> 4)
        self._samples = self._taken = 0

    def _limit(self, low, high):
        """Move `_end` to the middle of two limits of the sample's end, and correct the period.

        The limits `low` and `high` are relative to `_end`, in Q8 us (1/256 us).
        """
        part = self._fraction + (high + low >> 1)
        self._end = self._add(self._end, part >> _Q)
        self._fraction = part & 255
        self._half = half = high - low >> 1
        samples = self._samples
        if samples > 0:
            span_us = self._diff(self._end, self._reference)
            if span_us < _SPAN_MAX_US:
                self._correct(span_us, (half + self._was_half) // samples + self._drift)
            self._measure(self._taken + samples)
            if span_us <= _SPAN_US and half >= self._was_half >> 2:
                return
        self._begin_span(self._taken + samples)

    def _correct(self, span_us, unsure):
        if unsure > self._unsure:
            # Older estimates lose weight, because the oscillator drifts.
            self._unsure += self._drift >> 2
            return
        self._unsure = unsure
        self._exact = ((span_us << _Q) + self._fraction) // self._samples
        self._chip_us = self._exact >> _Q
        self._set_period(self._exact - unsure >> _Q)

    def _begin_span(self, taken):
        # Compute the period from this sample on. Restart the measurement for `learn`, too, if the
        # end of this sample is known much better than the end of the measurement's first sample, or
        # if the measurement is longer than LONG_US.
        if taken and (
            self._half < self._first_half >> 2 or self._diff(self._end, self._first) > LONG_US
        ):
            taken = 0
        self._taken = taken
        self._samples = 0
        self._reference = self._end
        self._was_half = self._half
        if not taken:
            self._first = self._end
            self._first_half = self._half

    def _measure(self, samples):
        # The measurement for `learn`: all samples since `_first`.
        lasted_us = self._diff(self._end, self._first)
        error_us = (self._half + self._first_half >> _Q) + 1
        if error_us < lasted_us >> _SHARE:
            self.sampled = samples
            self.lasted_us = lasted_us - error_us
            self.longest_us = lasted_us + error_us
