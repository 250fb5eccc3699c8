"""`microcontroller` of the virtual board."""

import os

import _protocol
import _simulator
from watchdog import WatchDogMode

from spots_device.runtime.common import rp2_mC


class Pin:
    def __init__(self, wire=None):
        self.wire = wire
        self.taken = False


class Processor:
    @property
    def uid(self):
        text = os.getenv("SPOTS_BOARD_ID")
        return bytearray(int(text[i : i + 2], 16) for i in range(0, len(text), 2))

    @property
    def temperature(self):
        return rp2_mC(_read_u16) / 1000


_reading = bytearray(2)


def _read_u16():
    _simulator.call(_protocol.HEAT, 0, 0, 2, _reading)
    return _reading[0] | _reading[1] << 8


cpu = Processor()


class WatchDogTimer:
    """Watchdog as on an RP2040; in the mode RESET, the watchdog cannot be stopped."""

    def __init__(self):
        self.timeout = None
        self._mode = None

    @property
    def mode(self):
        return self._mode

    @mode.setter
    def mode(self, mode):
        if mode is not WatchDogMode.RESET:
            raise NotImplementedError
        if self.timeout is None:
            raise ValueError("timeout must be set first")
        self._mode = mode
        self.feed()

    def feed(self):
        if self._mode is None:
            raise ValueError("the watchdog does not run")
        ms = int(1000 * self.timeout)
        _simulator.call(_protocol.FEED, ms & 0xFF, ms >> 8 & 0xFF, ms >> 16)


watchdog = WatchDogTimer()


def delay_us(delay):
    _simulator.sleep_us(delay)


def reset():
    _simulator.call(_protocol.RESET, 0, 0, 0)  # no answer comes
