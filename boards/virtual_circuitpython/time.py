"""`time` of the virtual board. `sleep` rounds to milliseconds, as in CircuitPython."""

import os

import _protocol
import _simulator
import utime

_last_us = _wraps = 0

if _simulator.simulated_time:

    def monotonic_ns():
        global _last_us, _wraps
        if _simulator.now_us < _last_us:
            _wraps += 1
        _last_us = _simulator.now_us
        return 1000 * (_wraps * _protocol.PERIOD_US + _last_us)

else:
    # Error of the board's oscillator in ppm.
    _ppm = int(os.getenv("SPOTS_CLOCK_PPM"))

    def monotonic_ns():
        ns = utime.time_ns()
        return ns + ns // 1_000_000 * _ppm


def monotonic():
    return monotonic_ns() * 1e-9


def sleep(seconds):
    _simulator.sleep_us(1000 * int(1000 * seconds + 0.5))
