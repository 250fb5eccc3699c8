"""`machine` of the virtual board: adds pins, I2C, watchdog and USB to the built-in module."""

import os

import _protocol
import _simulator
from umachine import *  # noqa: F403

_wires = {}  # wire of an I2C bus by number of its pin
_STRIP_LED_PINS = {15: 0, 14: _protocol.SECOND_BUS}  # bus of the strip whose LED the pin switches


class Pin:
    """A pin with a number. While the virtual board's button is pressed, every input is low."""

    IN = 0
    OUT = 1
    OPEN_DRAIN = 2
    PULL_UP = 1

    def __init__(self, number, mode=-1, pull=-1, *, value=None):
        self.number = number
        if value is not None:
            self.value(value)

    def value(self, level=None):
        wire = _wires.get(self.number)
        if level is not None and self.number in _STRIP_LED_PINS:
            bus = _STRIP_LED_PINS[self.number]
            _simulator.call(_protocol.LIGHT, bus | (1 if level else 0), 0, 0)
        elif level is not None:
            _simulator.set_wire(wire, level)
        elif wire is not None and wire % _simulator.WIRES == _simulator.SDA:
            return _simulator.sda(wire // _simulator.WIRES)
        else:
            return int(os.getenv("SPOTS_BUTTON") != "held")


class I2C:
    """An I2C controller on the simulated bus. Transfers allocate nothing.

    If the chip refuses a data byte, there is no OSError, as on an RP2040: `readfrom_mem_into` reads
    nothing then (extmod/machine_i2c.c), and `writeto` returns the number of acknowledged bytes.
    """

    def __init__(self, id, *, scl, sda, freq=400_000, timeout=50_000):
        first = _simulator.WIRES * id
        _wires[scl.number], _wires[sda.number] = first + _simulator.SCL, first + _simulator.SDA
        khz = freq // 1000
        self._bus = _protocol.SECOND_BUS * id
        _simulator.call(_protocol.SPEED, khz & 0xFF, khz >> 8, self._bus)

    def readfrom_mem_into(self, addr, memaddr, buf):
        try:
            _simulator.call(_protocol.READ, addr | self._bus, memaddr, len(buf), buf)
        except OSError as error:
            _raise_unless_refused(error)

    def writeto(self, addr, buf):
        try:
            _simulator.call(_protocol.WRITE, addr | self._bus, len(buf), 0, buf)
            return len(buf)
        except OSError as error:
            _raise_unless_refused(error)
            return 0


def _raise_unless_refused(error):
    if error.errno != _protocol.REFUSED:
        raise error


class WDT:
    """A watchdog, which cannot be stopped."""

    def __init__(self, id=0, timeout=5000):
        self._ms = timeout
        self.feed()

    def feed(self):
        _simulator.call(_protocol.FEED, self._ms & 0xFF, self._ms >> 8 & 0xFF, self._ms >> 16)


class USBDevice:
    """Empty class: its presence shows that the board supports USB; `usb.device` simulates USB."""


def unique_id():
    text = os.getenv("SPOTS_BOARD_ID")
    return bytes(int(text[i : i + 2], 16) for i in range(0, len(text), 2))


def reset():
    _simulator.call(_protocol.RESET, 0, 0, 0)  # no answer comes
