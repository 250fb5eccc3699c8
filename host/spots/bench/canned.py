"""Runs in MicroPython: the sample path of the firmware on canned registers, clock and port.

Stands where bus, clock and serial port stand on a board, and allocates nothing itself, so that
what a sample costs is the firmware's own. Used by the benchmark and by the tests.
"""

from tactile.app import App

_AINT = 0x08
_PERIOD = 1 << 30


class Clock:
    """Ticks that advance when someone sleeps or a transfer takes place."""

    def __init__(self):
        self.now = 0

    def ticks_us(self):
        return self.now

    def ticks_add(self, ticks, delta):
        return (ticks + delta) & (_PERIOD - 1)

    def ticks_diff(self, end, start):
        return ((end - start + (_PERIOD >> 1)) & (_PERIOD - 1)) - (_PERIOD >> 1)

    def sleep_us(self, us):
        self.now = (self.now + us) & (_PERIOD - 1)


class Bus:
    """Registers of a chip that always has a new sample."""

    def __init__(self):
        self.registers = bytearray(256)
        self.registers[0x92] = 0x24

    def counts(self, values):
        """Let every sample from now on be these six counts."""
        for i in range(6):
            self.registers[0x95 + 2 * i] = values[i] & 0xFF
            self.registers[0x96 + 2 * i] = values[i] >> 8

    def read_into(self, register, buffer):
        registers = self.registers
        registers[0x93] = _AINT
        for i in range(len(buffer)):
            buffer[i] = registers[register + i]

    def write(self, buffer):
        register = buffer[0]
        for i in range(1, len(buffer)):
            self.registers[register + i - 1] = buffer[i]
        self.registers[0x80] &= 0xEF  # a SMUX command is done at once


class Serial:
    """A port that takes everything and keeps the last frame."""

    def __init__(self):
        self.last = bytearray(600)
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


def app(calibration=()):
    """Return (App, Bus, Clock, Serial), past the dark window, streaming readings and spectra.

    Parameters
    ----------
    calibration : sequence of str
        Lines of a calibration made on board ``00`` at the default settings.
    """
    bus, clock, serial = Bus(), Clock(), Serial()
    made = App(BoardConfig, "canned", "00", bus, clock, serial)
    made.step()
    made.use_calibration(list(calibration))
    strip = made.strip
    strip.stream_touch = strip.stream_spectrum = True
    bus.counts((1, 0, 2, 1, 0, 1))
    for _ in range(40):
        made.step()
    return made, bus, clock, serial
