"""Answers the virtual board's requests from a simulated bus and USB host."""

from __future__ import annotations

import os

from spots.errors import SpotsError

from .bus import I2CBus
from .protocol import protocol
from .usb import UsbHost


def read_request(fd: int) -> bytes | None:
    """Return a request with what it carries, or None if the board closed the pipe."""
    header = os.read(fd, 4)
    if len(header) < 4:
        return None
    size = header[2] if header[0] in protocol.SENDS else 0
    return header + os.read(fd, size) if size else header


def is_reset(request: bytes) -> bool:
    """Return whether the board asks for its own hard reset, which has no answer."""
    return request[:1] == bytes([protocol.RESET])


def is_poll(request: bytes) -> bool:
    """Return whether the request is a read of registers: most passes of the loop have one."""
    return request[:1] == bytes([protocol.READ])


def reported_free_bytes(request: bytes) -> int | None:
    """Return the free heap that the board reports, which has no answer, or None."""
    return _number(request) if request[:1] == bytes([protocol.MEMORY]) else None


def fed_for_us(request: bytes) -> int | None:
    """Return how long a watchdog waits that this request feeds, or None if it feeds none."""
    return 1000 * _number(request) if request[:1] == bytes([protocol.FEED]) else None


def _number(request: bytes) -> int:
    return int.from_bytes(request[1:4], "little")


def answer(request: bytes, bus: I2CBus, usb: UsbHost, fd: int, rate: float = 1.0) -> None:
    """Carry a request out and write its answer, in one piece.

    Parameters
    ----------
    request : bytes
    bus : bus.I2CBus
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
    data, error, (_, a, b, c) = b"", 0, request[:4]
    try:
        match request[0]:
            case protocol.SLEEP:
                bus.clock.spend_us(_number(request) / rate)
            case protocol.SPEED:
                bus.frequency_hz = 1000 * _number(request)
            case protocol.READ:
                data = bus.write_read(a, bytes((b,)), c)
            case protocol.RECEIVE:
                data = bus.read(a, c)
            case protocol.LINES:
                data = bytes((bus.lines(a, b),))
            case protocol.LIGHT:
                bus.light(a)
            case protocol.HID:
                usb.offer(a, request[4:])
            case protocol.HOST:
                usb.look()
            case protocol.WRITE:
                bus.write(a, request[4:])
            case protocol.FEED:
                pass  # the caller, who can see the board hang, keeps the time: `fed_for_us`
    except OSError as failure:
        error = failure.errno
    now = int(bus.clock.now_us() * rate) % protocol.PERIOD_US
    reply = bytes((error,)) + now.to_bytes(4, "little") + (b"" if error else data)
    try:
        os.write(fd, reply)  # shorter than PIPE_BUF: wholly or not at all
    except BrokenPipeError:
        pass  # the next request will not come, which the caller sees
    except BlockingIOError:
        raise SpotsError("the virtual board stopped: it reads none of its answers") from None
