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


class ADC:
    """An ADC with one channel, the temperature sensor of the processor."""

    CORE_TEMP = 4

    def __init__(self, channel):
        self._reading = bytearray(2)

    def read_u16(self):
        _simulator.call(_protocol.HEAT, 0, 0, 2, self._reading)
        return self._reading[0] | self._reading[1] << 8


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
    """The USB device below the simulator's USB host, which takes every interface at once.

    Callbacks come when the firmware looks at the clock, because on a board they come from a task
    of MicroPython that runs between two bytecodes.
    """

    class BUILTIN_DEFAULT:
        """MicroPython's serial port: two interfaces and three endpoints."""

        itf_max = 2
        ep_max = 3
        desc_dev = b"\x12\x01\x00\x02\xef\x02\x01\x40\x8a\x2e\x05\x00\x00\x01\x01\x02\x03\x01"
        desc_cfg = b"\x09\x02\x09\x00\x02\x01\x00\xa0\x7d"  # without those of the serial port

    BUILTIN_NONE = None
    builtin_driver = None
    _made = None

    def __new__(cls):
        if cls._made is None:
            cls._made = object.__new__(cls)
            cls._made._pending = []
        return cls._made

    def active(self, value):
        _simulator.waiting = None
        if not value:
            return
        if self.builtin_driver is not USBDevice.BUILTIN_DEFAULT:
            raise SystemExit  # without the built-in driver, the board has no serial port
        at = 0
        while at < len(self._configuration):  # every interface that is no part of the serial port
            size, kind = self._configuration[at], self._configuration[at + 1]
            if kind == 4:
                self._opened(memoryview(self._configuration)[at:])
            at += size

    def config(self, device, configuration, strings, opened, reset, control, transferred):
        self._configuration, self._opened, self._transferred = configuration, opened, transferred
        self._pending = []

    def submit_xfer(self, endpoint, data):
        if endpoint in self._pending:
            raise OSError(16)
        self._offer(endpoint, data)
        self._pending.append(endpoint)
        _simulator.waiting = self._complete
        return True

    def _offer(self, endpoint, data):
        index = (endpoint & 15) - USBDevice.BUILTIN_DEFAULT.ep_max
        _simulator.call(_protocol.HID, index, len(data), 0, data)

    def _complete(self):
        for endpoint in self._pending:
            try:
                self._offer(endpoint, b"")
            except OSError as error:
                if error.errno != _protocol.EAGAIN:
                    raise
                continue  # the host has not fetched the report
            self._pending.remove(endpoint)
            self._transferred(endpoint, 0, 0)
            break
        if not self._pending:
            _simulator.waiting = None


def unique_id():
    text = os.getenv("SPOTS_BOARD_ID")
    return bytes(int(text[i : i + 2], 16) for i in range(0, len(text), 2))


def reset():
    _simulator.call(_protocol.RESET, 0, 0, 0)  # no answer comes
