"""`usb_cdc` of the virtual board: a second serial port, if boot.py enables it.

A real board checks its console for Ctrl-C all the time; the virtual board checks its console only
at each read of the data port.
"""

import os
import select
import sys

_CTRL_C = 3
_FIFO = 256  # bytes that the USB stack takes in one write


class Serial:
    """A serial port that never blocks; requires timeouts of 0, as a real port blocks otherwise."""

    def __init__(self, read_fd, write_fd):
        self.timeout = None
        self.write_timeout = None
        self._in = open(read_fd, "rb")
        self._out = open(write_fd, "wb")
        self._readable = select.poll()
        self._readable.register(self._in, select.POLLIN)
        self._writable = select.poll()
        self._writable.register(self._out, select.POLLOUT)

    def readinto(self, buf):
        _look_for_ctrl_c()
        if self.timeout != 0:
            raise NotImplementedError("set timeout to 0: a real board would block for ever")
        for _ in self._readable.ipoll(0):
            return self._in.readinto(buf) or 0
        return 0

    def write(self, buf):
        if self.write_timeout != 0:
            raise NotImplementedError("set write_timeout to 0: a real board may block for ever")
        for _ in self._writable.ipoll(0):
            return self._out.write(buf, min(len(buf), _FIFO)) or 0
        return 0


console = None
data = None

_wanted = {"console": True, "data": False}
_started = False
_keys = select.poll()
_keys.register(sys.stdin, select.POLLIN)


def enable(*, console=True, data=False):
    if _started:
        raise RuntimeError("Cannot change USB devices now")
    _wanted["console"] = console
    _wanted["data"] = data


def disable():
    enable(console=False, data=False)


def start():
    """Start USB: create the ports that boot.py has enabled."""
    global data, _started
    _started = True
    if _wanted["data"]:
        data = Serial(int(os.getenv("SPOTS_DATA_IN")), int(os.getenv("SPOTS_DATA_OUT")))


def _look_for_ctrl_c():
    for _, event in _keys.ipoll(0):
        if event & select.POLLIN and sys.stdin.buffer.read(1) == bytes((_CTRL_C,)):
            raise KeyboardInterrupt
