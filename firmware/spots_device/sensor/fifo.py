"""Path of the samples through the chip's FIFO: many samples in each transfer.

The FIFO has 128 entries of two bytes, which is 21 samples of six counts. So the loop may stall for
20 exposures without loss. No published driver reads six channels from this FIFO, so it is not
certain that this works. Each start of the sensor tests it: the FIFO must contain the sample that is
in the data registers. If this test fails, the path `registers` is used.
"""

from errno import EIO

from .. import const
from ..runtime.common import ADDRESS
from . import chip as c

_HIGH = c.FIFO_DATA + 1  # index in the buffer of the high byte of the first count
_TRIALS = const(8)  # at most so many samples after a start may be absent from the FIFO
_BROKEN = const(2)  # value of `_odd_level` after a failed transfer from the FIFO


class Fifo:
    """Reads all samples of the FIFO, or those of `registers` if it does not work.

    Attributes and methods are those of `registers.Registers`.
    """

    def __init__(self, sensor, registers):
        self._sensor = sensor
        self._registers = registers
        view = memoryview(sensor.burst)
        self._level = view[c.LEVEL : c.OLDEST]
        self._levelled = view[c.LEVEL : c.FIFO_DATA]
        self._views = [None]  # by the number of samples
        for end in range(c.FIFO_DATA + c.SAMPLE_SIZE, len(view) + 1, c.SAMPLE_SIZE):
            self._views.append(view[c.FIFO_DATA : end])
        self._read = self.read  # binding a method allocates
        self.fifo = self._trials = 0
        # 1 if the last level was not a multiple of 6, `_BROKEN` after a failed transfer.
        self._odd_level = 0

    def start(self):
        self.fifo = self._odd_level = 0
        self._trials = _TRIALS
        return self._try

    def _try(self):
        # Read the data registers, until the FIFO contains the same sample.
        if not self._registers.fetch():
            return 0
        self._trials -= 1
        samples = self.read() if self._read_level() >= c.ENTRIES else 0
        if samples:
            self.fifo = 1
            self._sensor.read = self._read
            return samples
        if not self._trials:
            self._sensor.follow(self._registers)
        return self._registers.stamp()

    def read(self):
        """Read all samples of the FIFO, see `registers.Registers.read`.

        If the FIFO certainly contains a sample, one transfer reads the level and the oldest sample:
        the chip's register pointer goes on from the level to the data. If the FIFO is empty then, a
        sample that the chip stores during the transfer may be read in part. So the FIFO is cleared,
        and the sample counts as missed.
        """
        sensor = self._sensor
        sure = sensor.pacing.sure_polls > 0 or not self.fifo
        sensor.burst[c.LEVEL] = c.UNREAD
        sensor.bus.read_into(ADDRESS, c.FIFO_LVL, self._levelled if sure else self._level)
        level = sensor.burst[c.LEVEL]
        # The clock is read only where its time is needed: on CircuitPython this allocates.
        sensor.known = sensor.asked if level < c.ENTRIES << sure else sensor.ticks_us()
        # While the chip stores a sample, the level may for a moment not be a multiple of 6.
        odd = 1 if level % c.ENTRIES else 0
        if level > c.FULL or self._odd_level + odd > 1 or (sure and level < c.ENTRIES):
            if level == c.UNREAD:
                raise OSError(EIO)
            self._clear()
            level = odd = 0
        level //= c.ENTRIES
        if not level:
            # The FIFO does not contain ASTATUS. A poll that is early has time to read it.
            sensor.burst[c.ASTATUS_AT] = sensor.read_byte(c.ASTATUS)
        elif level > sure:
            self._odd_level = _BROKEN  # unless the transfer succeeds
            sensor.burst[_HIGH] = c.UNREAD
            level -= sure  # an expression in the call would need a larger call frame, see strip.py
            sensor.bus.read_into(ADDRESS, c.FDATA, self._views[level])
            level += sure
            # Only with the longest exposures, the chip returns counts with this high byte.
            if sensor.burst[_HIGH] == c.UNREAD and self._read_level() >= c.ENTRIES:
                raise OSError(EIO)
        self._odd_level = odd
        if not level or not (self.fifo or self._contains(level)):
            return 0
        sensor.at = c.OLDEST if sure else c.FIFO_DATA
        sensor.complete = sensor.pacing.held(sensor.asked, sensor.known, level)
        if level > 2:
            sensor.step_us = sensor.pacing.skip(level - 2)
        return level

    def _contains(self, samples):
        # Return whether one of these samples is the one in the data registers.
        burst = self._sensor.burst
        at = c.OLDEST
        while samples:
            i = c.COUNTS
            while i < c.LEVEL and burst[i] == burst[at]:
                i += 1
                at += 1
            if i == c.LEVEL:
                return True
            at += c.LEVEL - i
            samples -= 1
        self._trials = 0
        return False

    def _read_level(self):
        burst = self._sensor.burst
        burst[c.LEVEL] = c.UNREAD
        self._sensor.bus.read_into(ADDRESS, c.FIFO_LVL, self._level)
        if burst[c.LEVEL] == c.UNREAD:
            raise OSError(EIO)
        return burst[c.LEVEL]

    def _clear(self):
        sensor = self._sensor
        sensor.write(c.CONTROL, c.FIFO_CLR)
        sensor.complete = sensor.asked = sensor.ticks_us()
        sensor.pacing.overrun(sensor.asked)
        if not self.fifo:
            sensor.write(c.STATUS, c.AINT)  # the sample of this AINT is no longer in the FIFO
            self._trials = _TRIALS

    def fail(self):
        if self._sensor.pacing.sure_polls > 0 or not self.fifo:
            self._odd_level = _BROKEN  # the transfer may have read a part of a sample
