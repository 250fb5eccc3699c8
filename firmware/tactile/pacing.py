"""When to ask the sensor next, so that one burst finds one new sample.

The chip samples on its own oscillator, some per cent off the board's. A poll that comes too
early and the one that then succeeds bracket the end of a sample; two brackets n samples apart
bound the period from below. Polling by that bound, and a little earlier still, never
oversleeps, and comes too early about once in twenty samples. Integers only, allocates nothing.
"""

RETRY_US = 200
_WIDE_US = 2_000  # a bracket wider than this dates nothing
_TRUST = 16  # the oscillator may run a sixteenth fast
_FRESH = 64  # samples after which a bound may replace a higher one
_RENEW = 256  # samples after which the reference moves on, to follow temperature


class Pacing:
    """A lock on the sensor's sample clock.

    Parameters
    ----------
    clock : object
        ``ticks_add(ticks, us)`` and ``ticks_diff(later, earlier)``, as in MicroPython's ``time``.
    """

    def __init__(self, clock):
        self._add = clock.ticks_add
        self._diff = clock.ticks_diff
        self.due = 0
        self.missed = 0
        self.period_us = 0
        self._creep = 0
        self._early = 0
        self._was_early = False
        self._locked = False
        self._reference = 0
        self._samples = -1  # since the reference; -1 for no reference

    def start(self, now, period_us):
        """Begin anew: a first sample of nominally `period_us` has just been started."""
        self.period_us = period_us - period_us // _TRUST
        self._creep = period_us >> 8
        self.due = self._add(now, self.period_us)
        self.missed = 0  # samples that were overslept
        self._was_early = False
        self._locked = False
        self._samples = -1

    def early(self, now):
        """Take note that a poll which began at `now` found nothing, and ask again soon."""
        self._early = now
        self._was_early = True
        self.due = self._add(now, RETRY_US)

    def found(self, before, after):
        """Take note that a poll between two moments found a sample, and aim at the next.

        Returns
        -------
        int or None
            Ticks at which that sample was complete, as the lock has it. None if that cannot be
            told, after a stall: then it must not be used, and `missed` has grown.
        """
        late = self._diff(after, self.due)
        if self._was_early:
            doubtful = self._diff(before, self._early) > _WIDE_US
        else:
            doubtful = not self._locked
        if doubtful or late > self.period_us - (self.period_us >> 2):
            self.missed += max(0, late // self.period_us) + 1
            self._locked = False
            self._was_early = False
            self._samples = -1
            self.due = self._add(after, RETRY_US)
            return None
        if self._was_early:
            self._bound(before)
            self.due = before
        complete = self.due
        self._locked = True
        self._was_early = False
        self._samples += 1
        self.due = self._add(complete, self.period_us - self._creep)
        return complete

    def _bound(self, now):
        if self._samples > 0:
            bound = self._diff(self._early, self._reference) // self._samples
            if bound > self.period_us or self._samples >= _FRESH:
                self.period_us = bound
        if self._samples < 0 or self._samples >= _RENEW:
            self._reference = now
            self._samples = 0
