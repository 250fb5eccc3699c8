"""Answers the virtual board's requests from a simulated bus and USB host.

A request is 4 bytes: operation and three arguments; see boards/_virtual/_simulator.py.
"""

from __future__ import annotations

import os

from spots.errors import SpotsError

from .bus import Bus
from .usb import UsbHost

_TICKS = 1 << 30


def read_request(fd: int) -> bytes | None:
    """Return a request's 4 bytes and what it writes, or None if the board closed the pipe."""
    header = os.read(fd, 4)
    if len(header) < 4:
        return None
    size = header[2] if header[:1] in (b"W", b"H") else 0
    return header + os.read(fd, size) if size else header


def is_reset(request: bytes) -> bool:
    """Return whether the board asks for its own hard reset, which has no answer."""
    return request[:1] == b"X"


def is_poll(request: bytes) -> bool:
    """Return whether the request is a read of registers: most passes of the loop have one."""
    return request[:1] == b"R"


def told_free_bytes(request: bytes) -> int | None:
    """Return how much memory the board says it has left, which has no answer, or None."""
    return int.from_bytes(request[1:4], "little") if request[:1] == b"M" else None


def fed_for_us(request: bytes) -> int | None:
    """Return how long a watchdog waits that this request feeds, or None if it feeds none."""
    return 1000 * int.from_bytes(request[1:4], "little") if request[:1] == b"D" else None


def answer(request: bytes, bus: Bus, usb: UsbHost, fd: int, rate: float = 1.0) -> None:
    """Carry a request out and write its answer, in one piece.

    Parameters
    ----------
    request : bytes
    bus : bus.Bus
    usb : usb.UsbHost
    fd : int
        Where to write.
    rate : float
        Seconds that the board counts in one.

    Raises
    ------
    SpotsError
        If the board has left so many answers unread that no more fit into the pipe.
    """
    data, error = b"", 0
    try:
        if request[:1] == b"S":
            bus.clock.spend_us((request[1] | request[2] << 8 | request[3] << 16) / rate)
        elif request[:1] == b"F":
            bus.frequency_hz = 1000 * (request[1] | request[2] << 8)
        elif request[:1] == b"R":
            data = bus.write_read(request[1], request[2:3], request[3])
        elif request[:1] == b"G":
            data = bus.read(request[1], request[3])
        elif request[:1] == b"L":
            data = bytes((bus.lines(request[1], request[2]),))
        elif request[:1] == b"H":
            usb.offer(request[1], request[4:])
        elif request[:1] == b"U":
            usb.look()
        elif request[:1] == b"D":
            pass  # who can see the board hang keeps the time, see `fed_for_us`
        else:
            bus.write(request[1], request[4:])
    except OSError as failure:
        error = failure.errno
    now = int(bus.clock.now_us() * rate) % _TICKS
    reply = bytes((error,)) + now.to_bytes(4, "little") + (b"" if error else data)
    try:
        os.write(fd, reply)  # shorter than PIPE_BUF: wholly or not at all
    except BrokenPipeError:
        pass  # the next request will not come, and tell
    except BlockingIOError:
        raise SpotsError("the virtual board stopped: it reads none of its answers") from None
