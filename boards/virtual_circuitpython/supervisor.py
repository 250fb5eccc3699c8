"""`supervisor` of the virtual board: ticks, and whether a USB host is connected and awake."""

import time

import _protocol
import _simulator


class Runtime:
    @property
    def usb_connected(self):
        try:
            _simulator.call(_protocol.HOST, 0, 0, 0)
        except OSError:
            return False
        return True


runtime = Runtime()


def ticks_ms():
    return time.monotonic_ns() // 1_000_000 % (1 << 29)
