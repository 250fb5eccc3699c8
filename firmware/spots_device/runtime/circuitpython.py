"""CircuitPython's I2C bus, serial port and clock."""

import time

import microcontroller
import supervisor

from .. import const
from .common import ADDRESS

# `ticks_diff` adds half a period. With a period of 2**30 us, the sum would not fit a small integer,
# and would allocate.
_PERIOD_US = const(1 << 29)
_HALF_PERIOD_US = const(1 << 28)
_MAX_TICKS = const((1 << 29) - 1)  # both of this clock, in us, and of `supervisor.ticks_ms`
_MAX_NS = const((1 << 30) - 1)  # the lowest 30 bits of a time, which wrap after 1.07 s
_LONG_MS = const(1_000)
_FINISH_US = const(20_000)  # longest wait for the rest of a TEXT frame
_COMMON_SIZE = const(64)  # sizes up to this one get a cached view
_EARLY_US = const(2_000)  # more than the error of a time that is computed from milliseconds
_MARGIN_MS = const(4)  # more than this error, that of `sleep`, and `_EARLY_US` together


class BusioBus:
    """Reads and writes the sensor's registers over ``busio``.

    Adafruit's driver uses the same bus. So each transfer locks the bus, but without Adafruit's
    I2CDevice, which takes longer and allocates memory.
    """

    def __init__(self, i2c):
        self._i2c = i2c
        self._register = bytearray(1)

    def read_into(self, address, register, buffer):
        i2c = self._i2c
        self._register[0] = register
        while not i2c.try_lock():
            pass
        try:
            i2c.writeto_then_readfrom(address, self._register, buffer)
        finally:
            i2c.unlock()

    def write(self, buffer):
        i2c = self._i2c
        while not i2c.try_lock():
            pass
        try:
            i2c.writeto(ADDRESS, buffer)
        finally:
            i2c.unlock()


class MonotonicClock:
    """Clock with the functions of MicroPython's ``time``, and two for a loop without garbage.

    CircuitPython's only clock with microseconds returns a long integer, so each read of the clock
    allocates 32 bytes. A loop that waits for a time needs one read if it computes the duration with
    `ticks_early_us`, and sleeps with `sleep_early_us`.
    """

    def __init__(self):
        self._early = self._read = self._ns = 0
        self._end = None  # of a sleep that has just ended
        self._read_ms = supervisor.ticks_ms() - _LONG_MS
        self.ticks_us()

    def ticks_us(self):
        """Return the time; the first call after `sleep_early_us` returns the end of this sleep."""
        end = self._end
        if end is not None:
            self._end = None
            return end
        now_ms = supervisor.ticks_ms()
        now = time.monotonic_ns()
        # `hash` as in `_high_half`. A division of the long integer would allocate 32 bytes more.
        ns = hash(now) & _MAX_NS
        if now_ms - self._read_ms & _MAX_TICKS < _LONG_MS:
            passed_ns = ns - self._ns & _MAX_NS
            self._read = self._read + passed_ns // 1000 & _MAX_TICKS
            ns -= passed_ns % 1000
        else:
            self._read = hash(now // 1000) & _MAX_TICKS
        self._ns = ns
        self._read_ms = now_ms
        return self._read

    def ticks_early_us(self):
        """Return the time of `ticks_us`, but 1 to 3 ms too early; allocates nothing."""
        self._end = None
        passed_ms = supervisor.ticks_ms() - self._read_ms & _MAX_TICKS
        self._early = (self._read + 1000 * passed_ms - _EARLY_US) % _PERIOD_US
        return self._early

    def sleep_early_us(self, us):
        """Sleep until `us` microseconds after the time that `ticks_early_us` has just returned."""
        ms = us // 1000 - _MARGIN_MS
        if ms > 0:
            time.sleep(ms / 1000)
        now = self.ticks_us()
        end = (self._early + us) % _PERIOD_US
        left_us = self.ticks_diff(end, now)
        if left_us > 0:
            microcontroller.delay_us(left_us)
            self._end = end

    @staticmethod
    def ticks_add(ticks, delta):
        return (ticks + delta) % _PERIOD_US

    @staticmethod
    def ticks_diff(end, start):
        return (end - start + _HALF_PERIOD_US) % _PERIOD_US - _HALF_PERIOD_US

    @staticmethod
    def sleep_us(us):
        # `sleep` rounds to milliseconds and serves USB meanwhile; `delay_us` does neither.
        ms = us // 1000
        if ms > 0:
            time.sleep(ms / 1000)
            us -= 1000 * ms
        if us > 0:
            microcontroller.delay_us(us)


views = {}  # by size: the last bytes object of this size, and a view of its first `size` bytes


def view_of(data, size):
    """Return a view of the first `size` bytes of `data`; cached, because slicing allocates."""
    view = views.get(size)
    if view is None or view[0] is not data:
        view = (data, memoryview(data)[:size])
        if size <= _COMMON_SIZE:
            views[size] = view
    return view[1]


class CdcSerial:
    """The USB serial port for frames and commands; the console is a separate port."""

    def __init__(self, port, clock):
        # With the default timeouts, None, calls would block for ever.
        port.timeout = 0
        port.write_timeout = 0
        self._port = port
        self._clock = clock
        self._byte = bytearray(1)

    def write(self, buffer, size):
        """Write a frame if the port has room; return whether it was sent completely.

        If the port takes only a part of a TEXT frame, wait up to 20 ms for the host to read. If it
        takes only a part of another frame, the rest is dropped: keys and samples never wait.
        """
        view = views.get(size)
        view = view[1] if view and view[0] is buffer else view_of(buffer, size)
        sent = self._port.write(view)
        return sent == size or (sent > 0 and size > _COMMON_SIZE and self._finish(view, sent))

    def read(self):
        """Return the next byte from the host, or -1 if no byte waits."""
        if self._port.readinto(self._byte) == 1:
            return self._byte[0]
        return -1

    def _finish(self, view, sent):
        clock = self._clock
        began = clock.ticks_us()
        while clock.ticks_diff(clock.ticks_us(), began) < _FINISH_US:
            sent += self._port.write(view[sent:])
            if sent == len(view):
                return True
            clock.sleep_us(1000)
        return False
