"""Path of the samples through the chip's data registers: one sample in each transfer.

It needs nothing but what published drivers use. A sample that the loop does not read before the
next one is complete is lost. `fifo` is the other path. Both have the attributes and methods of
`Registers`, except `fetch` and `stamp`.
"""

from errno import EIO

from ..runtime.common import ADDRESS
from . import chip as c

UNTIMED = -1  # result of `read`


class Registers:
    """Reads the sample in the data registers, if it is a new one, into the sensor's `burst`.

    `fifo` is 1 if samples come from the chip's FIFO instead.
    """

    fifo = 0

    def __init__(self, sensor):
        self._sensor = sensor
        self._status = memoryview(sensor.burst)[: c.LEVEL]
        self._read = self.read  # binding a method allocates

    def start(self):
        """Restart the path, because the sensor has started; return the function `read` to use."""
        return self._read

    def read(self):
        """Read new samples, and schedule the next poll; return how many. Allocates nothing.

        The sensor's `at` is then the place of the oldest one, and `complete` its end. `UNTIMED` if
        a sample must not be used, because its time is unknown after a stall. OSError if a transfer
        fails: the caller then calls `fail`.
        """
        return self.stamp() if self.fetch() else 0

    def fetch(self):
        """Read the data registers; return whether they contain a new sample.

        The chip's status bit AVALID cannot show a new sample, because it stays set between samples.
        The status bit AINT can, because each sample sets it. It is cleared after the read of the
        register ASTATUS, which latches the counts.
        """
        sensor = self._sensor
        burst = sensor.burst
        burst[c.STATUS_AT] = c.UNREAD
        sensor.bus.read_into(ADDRESS, c.STATUS, self._status)
        if not burst[c.STATUS_AT] & c.AINT:
            return False
        if burst[c.STATUS_AT] == c.UNREAD:
            raise OSError(EIO)
        sensor.write(c.STATUS, c.AINT)
        return True

    def stamp(self):
        """Return the result of `read` for a sample that `fetch` has found."""
        sensor = self._sensor
        complete = sensor.pacing.found(sensor.asked, sensor.ticks_us())
        sensor.complete = sensor.asked if complete is None else complete
        sensor.at = c.COUNTS
        return UNTIMED if complete is None else 1

    def fail(self):
        """Record that a transfer of `read` has failed."""
