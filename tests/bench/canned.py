"""Runs the firmware in MicroPython with substitutes for I2C bus, clock and serial port.

The substitutes allocate nothing, so the firmware allocates all memory that is allocated for a
sample. The benchmark and tests use this module.
"""

from spots_device.board.app import Board
from spots_device.sensor.as7341 import AS7341

_AINT = 0x08
_SP_EN = 0x02
_DARK_WINDOW_US = 200_000
_HALF = 1 << 29
_MASK = _HALF - 1 + _HALF  # computed without 2**30, which is not a small int on a 32-bit board


# A small calibration of the canned board.
CALIBRATION = [
    "board 00",
    "plan F3 F4 F5 F6 F7 F8",
    "made 9 10000 20",
    "touch 300 200",
    "coarse -4096 -4096 0 0 4096 4096",
    "fit 8192 -8192 0 0 0 0",
    "segment -8192 0 0 0 0 8192 0 0 0 0 0 8192",
    "f 1000 200 900",
    "f 100000 6000 90",
    "strain 0",
    "from 0",
    "x 0 0 5 100",
    "x 100000 8000 5 200",
]


class Clock:
    """A clock that advances only in `sleep_us`; transfers and arithmetic take no time."""

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
    """I2C bus with an AS7341 that samples without gaps and always has the same counts.

    Parameters
    ----------
    clock : Clock
        Determines when a sample ends.
    """

    def __init__(self, clock):
        self.registers = bytearray(256)
        self.registers[0x92] = 0x24
        self._clock = clock
        self._period_us = 0
        self._end = 0
        self._level = 0  # entries in the FIFO; all have the present counts

    def counts(self, values):
        """Set the six counts of all following samples."""
        for i in range(6):
            self.registers[0x95 + 2 * i] = values[i] & 0xFF
            self.registers[0x96 + 2 * i] = values[i] >> 8

    def read_into(self, _, register, buffer):
        if self._period_us:
            self._sample()
        if register < 0xFD:
            for i in range(len(buffer)):
                buffer[i] = self.registers[register + i]
            return
        at = 0
        if register == 0xFD:
            buffer[0] = self._level
            at = 1
        self._level -= (len(buffer) - at) // 2
        self._fill(buffer, at)

    def _fill(self, buffer, at):
        # A function of its own, so that its call frame needs no heap.
        for i in range(at, len(buffer)):
            buffer[i] = self.registers[0x95 + (i - at) % 12]

    def write(self, buffer):
        registers = self.registers
        register = buffer[0]
        if register == 0x93:
            registers[0x93] &= ~buffer[1]
            return
        for i in range(1, len(buffer)):
            registers[register + i - 1] = buffer[i]
        if register == 0xFA:
            self._level = 0
        registers[0x80] &= 0xEF  # the simulated chip executes a SMUX command immediately
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
            self._level = min(128, self._level + 6 * cycles)
            self._end = clock.ticks_add(self._end, cycles * self._period_us)


class Serial:
    """A serial port that accepts all frames and stores the last one."""

    def __init__(self):
        self.last = bytearray(900)
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
    """Substitute for board_config.py, the configuration of a board."""

    NAME = "canned"
    LED_MAX_MA = 100


def app(calibration=(), serial=None, usb=None, make=Board):
    """Start the firmware; return the board, and the substitutes for bus, clock and port.

    Its strip has a dark frame, and streams TOUCH and SPECTRUM frames.

    Parameters
    ----------
    calibration : sequence of str
        Lines of a calibration that was made on board ``00`` at the default settings.
    serial : object, optional
        Port to use instead of a new `Serial`.
    usb : object, optional
        USB stack, see `app.Board`.
    make : type, optional
        Class `Board` of another copy of the firmware.

    Returns
    -------
    board : app.Board
    bus : Bus
    clock : Clock
    serial : Serial
    """
    clock = Clock()
    bus, serial = Bus(clock), serial or Serial()
    made = make(BoardConfig, "canned", "00", lambda *_: AS7341(bus, clock), clock, serial, usb)
    made.step()
    made.strips[0].use_calibration(list(calibration))
    strip = made.strips[0].strip
    strip.stream_touch = strip.stream_spectrum = True
    bus.counts((1, 0, 2, 1, 0, 1))
    while clock.now < _DARK_WINDOW_US:
        made.step()
    return made, bus, clock, serial
