"""Schedules the polls of the sensor, and computes the times of its samples.

The chip has its own oscillator, which deviates from the board's clock by a few per cent. A poll
asks the sensor for a new sample. The loop may run a poll later than scheduled, so a poll only
limits the time at which a sample ended. A poll that finds the sample gives an upper limit; a poll
that is too early gives a lower limit. `Pacing` combines the limits of all polls: the next sample
ends within `_end` +- `_half`.

`_half` grows with each sample by the uncertainty of the period. If it becomes too large, the next
poll bisects: it is scheduled exactly at `_end`, and its result halves `_half`. All other polls are
scheduled after the latest possible end, so they find the sample even if they are late.

In 0.1 s, about two polls bisect. At the first start, the period is uncertain by 6 %. One second
later, the times are accurate to 20 us for exposures up to 10 ms. Integers only; allocates nothing.

A loop that is slower than the sensor never polls early. When it finds a sample, the end of this
sample was at most one period ago; with the FIFO, many polls together limit the times further.
Without a FIFO, the samples of a slow loop have this uncertainty, and it misses samples. They are
counted with the last measured period of the chip, scaled to the exposure. Samples in the chip's
FIFO are not lost while the loop stalls.
"""

from .. import const

_RETRY_US = const(200)
_WIDE_US = const(2_000)  # a wider bracket is not used if narrower ones are possible
# Of successive samples without a narrow bracket, the first one is dropped, and the next ones are
# used. If the period is at most this long, the first one is used too: the error of its time is
# small.
_SHORT_US = const(6_000)
_Q = const(20)  # of `_off`; fine enough: the rounding error is less than a step of any exposure
_TRUST = const(16)  # the oscillator may be fast by 1/16
_SLOW = const(3)  # a period that is longer by 1/8 is no error of the oscillator
_FINE = const(1_536)  # 6 us, Q8: with a larger `_half`, the next poll bisects
# After an early poll, polls within the same sample bisect until `_half` is at most 300 us (Q8).
_COARSE = const(300 << 8)
_MARGIN_US = const(30)  # a poll that does not bisect is this much after the latest possible end
# Time from the beginning of a poll until the chip latches the data that the poll reads: START and
# 3 bytes at 400 kHz.
_LATCH_US = const(75)
_BRIEF_US = const(1_000)  # in a longer poll, the loop has stalled before the chip was read
# The period is computed from the ends of two samples, about this far apart: it follows a drift.
_SPAN_US = const(2_000_000)
_SPAN_MAX_US = const(4_000_000)  # more would exceed 31 bits in Q8
_SHARE = const(12)  # a measurement of the period is valid if its error is below 1/4096
# More bisections in a row with the same result are improbable: the true end may be outside the
# limits, for example after a jump of the period.
_RUN = const(4)
_KNOWN = const(3)  # the times are known if their error is at most 1/8 of the period
_NEVER_US = const(1 << 28)


class Pacing:
    """Tracks the sample clock of the sensor, in ticks of MicroPython's ``time``.

    `due` is the time of the next poll. From `sure` (ticks) on, a poll certainly finds a sample,
    unless the chip's oscillator jumps. The last sample ended at most `slack_us` before its
    estimated end. `exposure_us` is the nominal period. In the last measurement, `sampled` samples,
    0 before the first one, have taken `lasted_us` to `longest_us` of the board's clock. `missed`
    counts the samples that were not read, or whose time is unknown; `start` does not reset it.
    """

    def __init__(self, clock):
        self._add = clock.ticks_add
        self._diff = clock.ticks_diff
        self._early = self._last = self._reference = self._end = self.missed = 0
        self._off = 0  # relative deviation of the chip's period from nominal, Q20
        self.start(0, 0)

    def start(self, now, period_us):
        """Restart the tracking. Allocates.

        The first sample begins at `now` (ticks); `period_us` is the nominal sample period.
        """
        self.exposure_us = period_us
        self._exact = (period_us << 8) + (period_us * self._off >> _Q - 8)  # estimate, Q8 us
        # Largest error of `_exact`, Q8 us: 1/16 of the period, or 1/1024 if the error of the
        # oscillator was measured before.
        self._unsure = period_us >> 2 if self._off else period_us << 4
        # The oscillator drifts: `_unsure` remains at least 30 ppm of the period.
        self._drift = (period_us >> 7) + 1
        self.due = self._add(now, period_us - period_us // _TRUST)
        self.slack_us = 0
        self.sampled = self.lasted_us = self.longest_us = 0
        self._fraction = 0  # Q8 us, to add to `_end`
        self._half = 0  # Q8 us
        self._run = 0  # bisections with the same result: positive if they found the sample
        self._samples = 0  # from `_reference` to `_end`
        self._was_early = False
        self._doubted = False  # whether `_doubt` got the last sample
        self._counted = False  # whether `_last`, the end of the last counted sample, is valid
        self._unlock(now)

    def nominal_us(self, period_us):
        """Convert `period_us` from the board's clock to the chip's clock; return it in us."""
        rate = (1 << _Q) + self._off
        return ((period_us << _Q) + (rate >> 1)) // rate

    def learn(self):
        """Update the stored deviation of the chip's oscillator from nominal. Allocates.

        The relative deviation is equal for all exposures.

        Call this before `start`. A measurement since the last `start` replaces the stored deviation
        if the two disagree.
        """
        if self.is_slow() or not self.sampled:
            return
        expected_us = self.sampled * self.exposure_us
        expected_us += expected_us * self._off >> _Q
        if self._off and self.lasted_us <= expected_us <= self.longest_us:
            return
        nominal_us = 2 * self.sampled * self.exposure_us
        late_us = self.lasted_us + self.longest_us - nominal_us
        self._off = ((late_us << _Q) + (nominal_us >> 1)) // nominal_us

    def is_slow(self):
        """Return whether the measured period is too long for the exposure. Allocates nothing."""
        period_us = self.exposure_us
        return self.lasted_us > self.sampled * (period_us + (period_us >> _SLOW))

    def early(self, now):
        """Record that the poll at `now` found no sample; schedule the next poll soon."""
        self._early = now
        self._was_early = True
        self.due = self._add(now, _RETRY_US)
        if self._locked:
            self._ends_after(now, 0)
            self._aim(_COARSE)

    def found(self, before, after):
        """Record that a poll, between two ticks, found a sample; schedule the next poll.

        Returns the estimated end of the sample, at most `slack_us` too late. None if the sample
        must not be used, because its time is unknown after a stall; `missed` then counts it.
        """
        if self._locked:
            # Another sample may have ended before `after`.
            error_us = self._half + self._unsure >> 8
            if self._diff(after, self._end) + error_us >= self._exact >> 8:
                return self._doubt(before, after)
        elif not self._was_early or self._diff(after, self._early) > _WIDE_US:
            return self._doubt(before, after)
        return self.held(before, after, 1)

    def held(self, before, after, samples):
        """Record the oldest of the samples that waited in the FIFO; schedule the next poll.

        The arguments are the ticks around the read of the FIFO's level, and how many samples
        waited. The result is as in `found`, never None.
        """
        if samples > 1:
            return self._oldest(before, after, samples)
        if self._fine <= 0:
            return self._place(before, after, 0)
        # Most samples: neither this poll nor the next one bisects, so no other call is necessary.
        end = self._end
        part = self._fraction + self._exact
        self._fraction = part & 255
        self._end = after = self._add(end, part >> 8)
        self._half += self._unsure
        self._samples += 1
        self._fine -= 1
        self.due = self.sure = self._add(after, (_FINE >> 8) + _MARGIN_US - _LATCH_US)
        return end

    def _oldest(self, before, after, samples):
        if self._locked and self._half <= self._exact >> _KNOWN:
            return self._advance(1)
        # The limits of the newest sample, less its distance, are limits of the oldest one.
        samples -= 1
        shift_us = -samples * (self._exact >> 8)
        samples *= self._unsure + 256  # the error, with that of the shift
        before = self._add(before, shift_us)
        after = self._add(after, shift_us)
        return self._place(before, after, samples)

    def _place(self, before, after, error):
        # A poll between two ticks found this sample, and no later one. `error`: of these times.
        if not self._locked:
            self._count(before, 1)
            self._lock(before, error)
        else:
            high = (self._diff(before, self._end) + _LATCH_US << 8) - self._fraction + error
            if high < self._half and self._diff(after, before) < _BRIEF_US:
                self._bound(-high, -1)
        self._was_early = False
        # It ended at most one period before the poll.
        self._ends_after(before, self._exact + self._unsure + error)
        end = self._advance(1)
        self._aim(_FINE)
        return end

    def skip(self, samples):
        """Record the samples of a FIFO read that are neither its oldest nor its newest.

        Call this after `held` for the oldest sample, and before `held` for the newest one. Returns
        the time from the end of a sample to the end of the next one, in us.
        """
        self._advance(samples)
        return self._exact + 128 >> 8

    def overrun(self, now):
        """Record that the FIFO was emptied at `now` (ticks), and that its samples are lost."""
        self._count(now, 0)
        self._unlock(now)

    def _unlock(self, now):
        self._locked = False  # `_end` and `_half` are not valid
        self._fine = 0  # number of next polls that need not bisect, less 1
        self.sure = self._add(now, _NEVER_US)

    def _advance(self, samples):
        """Predict the end of a later sample (`_end`, `_half`); return that of this one."""
        end = self._end
        part = self._fraction + samples * (self._exact & 255)
        self._fraction = part & 255
        part >>= 8
        part += samples * (self._exact >> 8)
        self._end = self._add(end, part)
        part = self._half + (samples - 1) * self._unsure
        self.slack_us = max(part, _FINE) >> 7
        self._half = part + self._unsure
        self._samples += samples
        self._fine = 0
        return end

    def _aim(self, bisected):
        # Schedule the next poll. The chip latches its data `_LATCH_US` after a poll begins.
        left = _FINE - self._half
        self._fine = left // self._unsure if left > 0 else 0
        self.sure = self._add(self._end, (max(self._half, _FINE) >> 8) + _MARGIN_US - _LATCH_US)
        self.due = self._add(self._end, -_LATCH_US) if self._half > bisected else self.sure

    def _ends_after(self, now, less):
        # The next sample ends after the poll at `now`, less a time in Q8 us.
        low = (self._diff(now, self._end) + _LATCH_US << 8) - self._fraction - less
        if low > -self._half:
            self._bound(low, 1)

    def _lock(self, now, error):
        """Restart the tracking at a sample that the poll at `now` has found.

        It ended at most one period before, or after the preceding poll if that was too early. The
        time has an error, in Q8 us.
        """
        width_us = self._exact >> 8
        if self._was_early:
            width_us = min(width_us, self._diff(now, self._early))
        self._end = self._add(now, _LATCH_US)
        self._fraction = self._run = self._samples = 0
        self._locked = True
        self._limit(-(width_us << 8) - error, error)

    def _bound(self, low, sign):
        # The sample ends after `low` (Q8 us, relative to `_end`). With the sign -1, `low` and the
        # limits here are mirrored at `_end`: the sample ended before `-low`.
        self._doubted = False
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
        self._samples = 0

    def _limit(self, low, high):
        """Move `_end` to the middle of two limits of the sample's end, and correct the period.

        The limits `low` and `high` are relative to `_end`, in Q8 us (1/256 us).
        """
        part = self._fraction + (high + low >> 1)
        self._end = self._add(self._end, part >> 8)
        self._fraction = part & 255
        self._half = high - low >> 1
        span_us = self._diff(self._end, self._reference)
        if self._samples > 0:
            if span_us < _SPAN_MAX_US:
                self._correct(span_us)
            if span_us <= _SPAN_US and self._half >= self._was_half >> 2:
                return
        self._samples = 0
        self._reference = self._end
        self._was_half = self._half

    def _correct(self, span_us):
        samples = self._samples
        error = self._half + self._was_half
        unsure = error // samples + self._drift
        if unsure > self._unsure:
            # Older estimates lose weight, because the oscillator drifts.
            self._unsure += self._drift >> 2
            return
        self._unsure = unsure
        self._exact = ((span_us << 8) + self._fraction) // samples
        error_us = (error >> 8) + 1
        if error_us < span_us >> _SHARE:
            self.sampled = samples
            self.lasted_us = span_us - error_us
            self.longest_us = span_us + error_us

    def _doubt(self, before, after):
        """Handle a sample that ended at an uncertain time; arguments and result as in `found`."""
        period_us = self._exact >> 8
        used = self._doubted or period_us <= _SHORT_US
        self._count(before, 1 if used else 0)
        self._unlock(after)
        self._doubted = True
        slack_us = period_us + period_us // _TRUST
        if self._was_early:
            slack_us = min(slack_us, max(0, self._diff(before, self._early)))
        if used and self._was_early and slack_us <= period_us >> 2:
            self._lock(before, 0)
            self._place(before, before, 0)
        else:
            self._was_early = False
            self.due = self._add(after, _RETRY_US)
        self.slack_us = slack_us
        return before if used else None

    def _count(self, now, read):
        """Count the samples since the last counted one, up to `now` (ticks); update `missed`.

        Returns the count, which is at least 1. `read` of these samples (0 or 1) were read; the
        others are missed.
        """
        period_us = self._exact >> 8
        if self._locked:
            self._last = self._add(self._end, -period_us)
        elif not self._counted:
            self._last = self._add(now, -period_us)
        self._counted = True
        ended = max(1, self._diff(now, self._last) // period_us)
        # The remainder counts in the next call, because loop and chip are not synchronous.
        self._last = self._add(self._last, ended * period_us)
        if self._diff(self._last, now) > period_us:
            self._last = now
        self.missed += ended - read
        return ended
