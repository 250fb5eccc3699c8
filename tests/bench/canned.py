"""Runs in MicroPython: the sample path of the firmware on canned registers, clock and port.

Stands where bus, clock and serial port stand on a board, and allocates nothing itself, so that
what a sample costs is the firmware's own. Used by the benchmark and by the tests.
"""

from spots_device.app import BoardApp
from spots_device.as7341 import AS7341

_AINT = 0x08
_SP_EN = 0x02
_DARK_WINDOW_US = 200_000
_HALF = 1 << 29
_MASK = _HALF - 1 + _HALF  # 2**30 itself is no small int on a 32-bit board


class Clock:
    """Ticks that advance when someone sleeps; transfers and arithmetic take no time."""

    def __init__(self):
        self.now = 0

    def ticks_us(self):
        return self.now

    def ticks_add(self, ticks, delta):
        return (ticks - _HALF + delta & _MASK) ^ _HALF

    def ticks_diff(self, end, start):
        return (end - start & _MASK ^ _HALF) - _HALF

    def sleep_us(self, us):
        self.now = self.ticks_add(self.now, us)


class Bus:
    """Registers of a chip that samples without a gap, by the clock, always the same counts.

    Parameters
    ----------
    clock : Clock
    """

    def __init__(self, clock):
        self.registers = bytearray(256)
        self.registers[0x92] = 0x24
        self._clock = clock
        self._period_us = 0
        self._end = 0

    def counts(self, values):
        """Let every sample from now on be these six counts."""
        for i in range(6):
            self.registers[0x95 + 2 * i] = values[i] & 0xFF
            self.registers[0x96 + 2 * i] = values[i] >> 8

    def read_into(self, register, buffer):
        registers = self.registers
        if self._period_us:
            self._sample()
        for i in range(len(buffer)):
            buffer[i] = registers[register + i]

    def write(self, buffer):
        registers = self.registers
        register = buffer[0]
        if register == 0x93:
            registers[0x93] &= ~buffer[1]
            return
        for i in range(1, len(buffer)):
            registers[register + i - 1] = buffer[i]
        registers[0x80] &= 0xEF  # a SMUX command is done at once
        if register == 0x80:
            self._start(registers[0x80] & _SP_EN)

    def recover(self):
        pass

    def _start(self, running):
        r = self.registers
        steps = (r[0x81] + 1) * ((r[0xCA] | r[0xCB] << 8) + 1)
        self._period_us = (steps * 278 + 50) // 100 if running else 0
        self._end = self._clock.ticks_add(self._clock.now, self._period_us)

    def _sample(self):
        clock = self._clock
        over_us = clock.ticks_diff(clock.now, self._end)
        if over_us >= 0:
            self.registers[0x93] |= _AINT
            cycles = over_us // self._period_us + 1
            self._end = clock.ticks_add(self._end, cycles * self._period_us)


class Serial:
    """A port that takes everything and keeps the last frame."""

    def __init__(self):
        self.last = bytearray(700)
        self.size = 0
        self.frames = 0

    def write(self, buffer, size):
        for i in range(size):
            self.last[i] = buffer[i]
        self.size = size
        self.frames += 1
        return True

    def read(self):
        return -1


class BoardConfig:
    """What board_config.py holds on a board."""

    NAME = "canned"
    LED_MAX_MA = 100


def app(calibration=(), serial=None, usb=None, make=BoardApp):
    """Return (App, Bus, Clock, Serial), past the dark window, streaming readings and spectra.

    Parameters
    ----------
    calibration : sequence of str
        Lines of a calibration made on board ``00`` at the default settings.
    serial : object, optional
        A port in place of `Serial`.
    usb : object, optional
        As `app.BoardApp` asks for.
    make : type, optional
        The `BoardApp` of another copy of the firmware.
    """
    clock = Clock()
    bus, serial = Bus(clock), serial or Serial()
    made = make(BoardConfig, "canned", "00", AS7341(bus, clock), clock, serial, usb)
    made.step()
    made.use_calibration(list(calibration))
    strip = made.strip
    strip.stream_touch = strip.stream_spectrum = True
    bus.counts((1, 0, 2, 1, 0, 1))
    while clock.now < _DARK_WINDOW_US:
        made.step()
    return made, bus, clock, serial
