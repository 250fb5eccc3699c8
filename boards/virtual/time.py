"""`time` of the virtual board: ticks wrap at 2**30 us as on a microcontroller.

In simulated time, only bus transfers, sleeps and added processor time (`_cpu`) advance the clock.
"""

import os

import _protocol
import _simulator
import utime
from utime import *  # noqa: F403

_PERIOD = _protocol.PERIOD_US
_HALF = _PERIOD >> 1


def ticks_add(ticks, delta):
    return (ticks + delta) & (_PERIOD - 1)


def ticks_diff(end, start):
    return ((end - start + _HALF) & (_PERIOD - 1)) - _HALF


if _simulator.simulated_time:

    def ticks_us():
        if _simulator.waiting:
            _simulator.waiting()
        return _simulator.now_us

else:
    # Error of the board's oscillator in ppm.
    _ppm = int(os.getenv("SPOTS_CLOCK_PPM"))

    def ticks_us():
        if _simulator.waiting:
            _simulator.waiting()
        us = utime.ticks_us()
        return us + us * _ppm // 1_000_000 & (_PERIOD - 1)


sleep_us = _simulator.sleep_us


def sleep_ms(ms):
    sleep_us(1000 * ms)


def sleep(seconds):
    sleep_us(int(1_000_000 * seconds))
