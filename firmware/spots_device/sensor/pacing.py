"""Schedules the polls of the sensor, so that each poll finds one new sample.

The chip has its own oscillator, which deviates from the board's clock by a few per cent. A poll
asks the sensor for a new sample. A poll that is too early and the next poll, which finds the
sample, bracket the end of the sample. Two brackets, n samples apart, give a lower bound of the
sample period. Each poll is scheduled slightly earlier than this bound predicts. So the scheduled
times do not fall behind the samples, and about one poll in twenty is early. Integers only;
allocates nothing.

A loop that is slower than the sensor never polls early, so it has no brackets. When it finds a
sample, the end of this sample was at most one period ago; this is the uncertainty of its time.
Without a FIFO, a slow loop misses samples. They are counted with the last measured period of the
chip, scaled to the exposure. Samples in the chip's FIFO are not lost while the loop stalls.

The loop may run a poll later than scheduled, so the times of polls are not the times of samples.
The times of samples are computed from the number of samples, and from estimates of the chip's
phase and period. A poll that finds one sample gives an upper limit of the sample's end; an early
poll gives a lower limit. Between two early polls, the polls approach the end in small steps, so
these limits soon differ by only one step. The error is half a step.
"""

from .. import const

_RETRY_US = const(200)
_WIDE_US = const(2_000)  # a wider bracket is not used if narrower ones are possible
# Of successive samples without a narrow bracket, the first one is dropped, and the next ones are
# used. If the period is at most this long, the first one is used too: the error of its time is
# small.
_SHORT_US = const(6_000)
_LEARN_US = const(200_000)  # after this time the lower bound of the period is accurate to 0.1 %
_Q = const(20)  # fine enough: the rounding error is less than a step of any exposure
_TRUST = const(16)  # the oscillator may be fast by 1/16
_SLOW = const(3)  # a period that is longer by 1/8 is no error of the oscillator
_FRESH = const(64)  # samples after which a bound may replace a higher one
# A measurement of the period is valid if its error is below 1/2048. It restarts after `LONG_US`,
# to follow temperature.
_SHARE = const(11)
LONG_US = 60_000_000
# Samples after which the bound gets a new reference, to follow temperature. With samples of 1 s,
# the time since the reference must also be below 2**28 us, because older ticks compare wrongly.
_RENEW = const(224)
# Time from the beginning of a poll until the chip latches the data that the poll reads: START and
# 3 bytes at 400 kHz.
LATCH_US = 75
BRIEF_US = 1_000  # in a longer poll, the loop has stalled before the chip was read
_SURE = const(16)  # samples after which the fit is more accurate than the times of the polls
# With this many samples in the fit, a poll is sure if it is later than the estimated end by at
# least this margin and a step.
_CERTAIN = const(63)
_MARGIN_US = const(30)
_FIT = const(300)  # largest weight of the fit, in samples, so that it follows temperature


class Pacing:
    """Tracks the sample clock of the sensor, in ticks of MicroPython's ``time``.

    `due` is the time of the next poll; `sure_polls`, from this one on, certainly find a sample,
    unless the chip's oscillator jumps. The last sample ended at most `slack_us` before its
    estimated end. `exposure_us` is the nominal period, `period_us` a lower bound of the measured
    one: `sampled` samples, 0 before the first measurement, have taken `lasted_us` to `longest_us`
    of the board's clock. `missed` counts the samples that were not read, or whose time is unknown;
    `start` does not reset it.
    """

    def __init__(self, clock):
        self._add = clock.ticks_add
        self._diff = clock.ticks_diff
        self._early = self._last = self._reference = self._first = self._began = self._end = 0
        self.missed = 0
        self._off = 0  # relative deviation of the chip's period from nominal, Q20
        self.start(0, 0)

    def start(self, now, period_us):
        """Restart the tracking. Allocates.

        The first sample begins at `now` (ticks); `period_us` is the nominal sample period.
        """
        self.exposure_us = period_us
        # Best estimate of the period; `period_us` is a lower bound.
        self._chip_us = period_us + (period_us * self._off >> _Q)
        self._exact = self._chip_us << 8  # estimate of the period, Q8 us
        self._fraction = 0  # Q8 us, to add to `_end`
        self._creep = period_us >> 8
        self._narrow_us = 2 * self._creep + 50
        self._set_period(period_us - period_us // _TRUST)
        self.due = self._add(now, self.period_us)
        self.slack_us = self.sure_polls = 0
        self.sampled = self.lasted_us = self.longest_us = 0
        self._was_early = False
        self._locked = False
        self._doubted = False  # whether `_doubt` got a sample since the last narrow bracket
        self._counted = False  # whether `_last`, the end of the last counted sample, is valid
        self._samples = -1  # samples since the reference; -1 without a reference
        self._taken = 0  # samples from the start of the measurement to the reference

    def nominal_us(self, period_us):
        """Convert `period_us` from the board's clock to the chip's clock; return it in us."""
        rate = (1 << _Q) + self._off
        return ((period_us << _Q) + (rate >> 1)) // rate

    def learn(self):
        """Update the stored deviation of the chip's oscillator from nominal. Allocates.

        The relative deviation is equal for all exposures.

        Call this before `start`. A measurement since the last `start` replaces the stored deviation
        if the two disagree. If there is neither a measurement nor a stored deviation, the lower
        bound of the period is used, after 0.2 s of samples: it is then accurate to 0.1 %.
        """
        if self.is_slow():
            return
        if self.sampled:
            expected_us = self.sampled * self.exposure_us
            expected_us += expected_us * self._off >> _Q
            if self._off and self.lasted_us <= expected_us <= self.longest_us:
                return
            lasted_us = self.lasted_us + self.longest_us
            nominal_us = 2 * self.sampled * self.exposure_us
        elif not self._off and (self._taken + self._samples) * self.period_us >= _LEARN_US:
            lasted_us = self.period_us
            nominal_us = self.exposure_us
        else:
            return
        self._off = ((lasted_us - nominal_us << _Q) + (nominal_us >> 1)) // nominal_us

    def is_slow(self):
        """Return whether the measured period is too long for the exposure. Allocates nothing."""
        period_us = self.exposure_us
        return self.lasted_us > self.sampled * (period_us + (period_us >> _SLOW))

    def early(self, now):
        """Record that the poll at `now` found no sample; schedule the next poll soon."""
        self._early = now
        self._was_early = True
        self.sure_polls = 0
        self.due = self._add(now, _RETRY_US)

    def found(self, before, after):
        """Record that a poll, between two ticks, found a sample; schedule the next poll.

        Returns the estimated end of the sample, at most `slack_us` too late. None if the sample
        must not be used, because its time is unknown after a stall; `missed` then counts it.
        """
        if self._was_early:
            if self._diff(after, self._early) > _WIDE_US:
                return self._doubt(before, after)
        elif not self._locked:
            return self._doubt(before, after)
        if self._diff(after, self.due) > self._late_us:
            return self._doubt(before, after)
        return self.held(before, after, 1)

    def held(self, before, after, samples):
        """Record the oldest of the samples that waited in the FIFO; schedule the next poll.

        The arguments are the ticks around the read of the FIFO's level, and how many samples
        waited. The result is as in `found`, never None.
        """
        if self._locked:
            shift_us = self._fraction + self._exact
            self._fraction = shift_us & 255
            self._end = ticks = self._add(self._end, shift_us >> 8)
            self._since += 1
            shift_us = self._diff(before, ticks) + LATCH_US
            if self.sure_polls > 0 and samples == 1 and shift_us <= self.period_us:
                self._samples += 1
                self.sure_polls -= 1
                if not self.sure_polls and shift_us < self._high_us:
                    self._high_us = shift_us
                self.due = self._add(self.due, self._step_us)
                return ticks
            if shift_us < self._high_us and samples == 1 and self._diff(after, before) < BRIEF_US:
                self._high_us = shift_us
            if self._was_early:
                self._follow_phase()
        ticks = self.due
        if self._was_early and samples == 1 and self._diff(after, self._early) <= _WIDE_US:
            self._bracket(before)
            ticks = before
        elif self._locked and samples == 1:
            # A poll is never before `due`. The next sample ends after `before`.
            if shift_us > self.period_us:
                shift_us = self._diff(before, ticks) - self.period_us
                if shift_us > 0:
                    ticks = self._add(ticks, shift_us)
            if self._fitted > _CERTAIN:
                shift_us = self._diff(ticks, self._end) + LATCH_US - _MARGIN_US - self._creep
                self.sure_polls = shift_us // self._drop_us
        else:
            self.sure_polls = 0
            # The newest sample ended before `after`, and the next one ends after `before`.
            shift_us = self._diff(after, ticks) - (samples - 1) * self._chip_us
            if self._locked and shift_us > 0:
                shift_us = self._diff(before, ticks) - samples * self._chip_us
                if shift_us < 0:
                    shift_us = 0
            ticks = self._add(ticks, shift_us)
            if not self._locked:
                self.slack_us = self.period_us
                self._count(ticks, 1)
        self._was_early = False
        if self._samples >= 0:
            self._samples += 1
        shift_us = self._step_us if samples == 1 else self._chip_us
        if not self._locked:
            # `after` is late: without this shift, no poll would be early, and no bracket found.
            shift_us -= self.period_us >> 2
        self.due = self._add(ticks, shift_us)
        return self._end if self._locked and self._fitted > _SURE else ticks

    def skip(self, samples):
        """Record the samples of a FIFO read that are neither its oldest nor its newest.

        Call this after `held` for the oldest sample, and before `held` for the newest one. Returns
        the time from the end of a sample to the end of the next one, in us.
        """
        shift_us = samples * self._chip_us
        self.due = self._add(self.due, shift_us)
        if not self._locked:
            self._last = self._add(self._last, shift_us)
            return self._chip_us
        exact = self._exact
        part = self._fraction + samples * (exact & 255)
        self._fraction = part & 255
        self._end = self._add(self._end, samples * (exact >> 8) + (part >> 8))
        self._since += samples
        self._samples += samples
        return exact + 128 >> 8 if self._fitted > _SURE else self._chip_us

    def overrun(self, now):
        """Record that the FIFO was emptied at `now` (ticks), and that its samples are lost."""
        self._count(now, 0)
        self._locked = False
        self.sure_polls = 0
        self._samples = -1

    def _bracket(self, now):
        self.slack_us = self._diff(now, self._early)
        self._doubted = False
        if not self._locked:
            # The sample ended slightly before this poll: half a period is added, to round.
            self._count(self._add(now, self._chip_us >> 1), 1)
            self._lock(now)
        if self._samples > 0:
            self._measure(now)
        if self._samples < 0 or self._diff(now, self._began) > LONG_US:
            self._begin(self._early, now)
        if self._samples < 0 or self._samples >= _RENEW:
            self._taken += max(0, self._samples)
            self._reference = now
            self._samples = 0
        self._locked = True
        # Each poll is earlier, relative to its sample, than the one before.
        self._drop_us = (self._exact >> 8) + 1 - self._step_us or 1

    def _lock(self, now):
        # The sample ended between the last early poll and the poll at `now`.
        self._end = self._add(now, LATCH_US - (self.slack_us >> 1))
        self._high_us = self.period_us
        self._fitted = self._since = self.sure_polls = 0

    def _follow_phase(self):
        # Correct the estimates of phase and period with the limits of the end of this sample.
        low_us = self._diff(self._early, self._end) + LATCH_US
        high_us = self._high_us
        self._high_us = self.period_us
        shift_us = low_us + high_us >> 1
        since = self._since
        if high_us - low_us > self._narrow_us:
            if low_us <= 0 <= high_us:
                return
            shift_us = low_us if low_us > 0 else high_us
        if abs(shift_us) > self._narrow_us:
            # The estimate is wrong, or has just begun.
            self._fitted = 0
            self._exact += (shift_us << 8) // since
        elif self._fitted:
            # The gains of a recursive fit of a line to the ends of the last `fitted` samples.
            self._fitted = fitted = min(self._fitted + since, _FIT)
            divisor = (fitted + since) * (fitted + 2 * since)
            self._exact += (shift_us * 6 * since << 8) // divisor
            shift_us = shift_us * 2 * (2 * fitted + since) * since // divisor
        else:
            self._fitted = 1
        self._since = 0
        self._end = self._add(self._end, shift_us)

    def _measure(self, now):
        bound = self._diff(self._early, self._reference) // self._samples
        if bound > self.period_us or self._samples >= _FRESH:
            self._chip_us = bound
            self._set_period(bound)
        low_us = self._diff(self._early, self._began)
        high_us = self._diff(now, self._first)
        if high_us - low_us << _SHARE < high_us:
            self.sampled = self._taken + self._samples
            self.lasted_us = low_us
            self.longest_us = high_us

    def _set_period(self, period_us):
        # Set the period, the time from a sample to the next poll, and the longest delay of a poll.
        self.period_us = period_us
        self._step_us = period_us - self._creep
        self._late_us = period_us - (period_us >> 2)

    def _begin(self, first, began):
        # The measurement begins at the end of a sample, which is between these two times.
        self._first = first
        self._began = began
        self._taken = -max(0, self._samples)

    def _doubt(self, before, after):
        """Handle a sample that ended at an uncertain time; arguments and result as in `found`."""
        used = self._doubted or self.period_us <= _SHORT_US
        self._count(before, 1 if used else 0)
        slack_us = self._chip_us + self._chip_us // _TRUST
        if self._was_early:
            slack_us = min(slack_us, max(0, self._diff(before, self._early)))
        bracketed = used and self._was_early and slack_us <= self.period_us >> 2
        self.slack_us = slack_us
        self._doubted = True
        self._locked = bracketed
        self._was_early = False
        if bracketed:
            self._lock(before)
            self._reference = before
            self._begin(self._early, before)
            self._taken = 0
            self._samples = 1
            self.due = self._add(before, self._step_us)
        else:
            self._samples = -1
            self.due = self._add(after, _RETRY_US)
        return before if used else None

    def _count(self, now, read):
        """Count the samples since the last counted one, up to `now` (ticks); update `missed`.

        The count is at least 1. `read` of these samples (0 or 1) were read; the others are missed.
        """
        if self._locked:
            self._last = self._add(self.due, self._creep - self.period_us)
        elif not self._counted:
            self._last = self._add(now, -self._chip_us)
        self._counted = True
        period_us = self._chip_us
        ended = max(1, self._diff(now, self._last) // period_us)
        # The remainder counts in the next call, because loop and chip are not synchronous.
        self._last = self._add(self._last, ended * period_us)
        if self._diff(self._last, now) > period_us:
            self._last = now
        self.missed += ended - read
