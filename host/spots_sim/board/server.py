"""Answers the virtual board's requests from a simulated bus and USB host.

The board sends a request for each I2C transfer, sleep, USB report and change of a pin. The module
`protocol` has the codes of all requests.
"""

from __future__ import annotations

import errno
import os
import struct

from spots.errors import PortError

from ..chip.bus import I2CBus
from . import thermometer
from .bluetooth import Bluetooth
from .protocol import protocol
from .usb import UsbHost

_LEVEL, _FDATA = 0xFD, 0xFE  # registers of the chip's FIFO
_PERIOD_US = protocol.PERIOD_US
_SENDS = frozenset(protocol.SENDS)
_ANSWER = struct.Struct("<iI")  # errno, clock
_SAMPLE_BYTES = 12
REPORTS = frozenset((protocol.MEMORY, protocol.BUSY))  # requests without an answer
_ON_A_BUS = frozenset(
    (protocol.READ, protocol.WRITE, protocol.RECEIVE, protocol.LINES, protocol.LIGHT, protocol.HEAT)
)


def read_request(fd: int) -> bytes | None:
    """Read one request of a board, with its data, from a pipe; return None if the pipe closed."""
    header = os.read(fd, 4)
    if len(header) < 4:
        return None
    if header[0] in _SENDS and header[2]:
        return header + os.read(fd, header[2])
    return header


def is_reset(request: bytes) -> bool:
    """Return whether a request is for a hard reset of the board; this request gets no answer."""
    return request[0] == protocol.RESET


def passes(request: bytes) -> tuple[int, int]:
    """Return how many passes of the firmware's loop to simulate before and after a request.

    The simulator adds the processor time of these passes to its clock.

    - Read of any registers except those of the FIFO: 1 before, 0 after.
    - Read of the sensor's FIFO: 0 before; after it, one pass for each sample that the read returns.
      Of a read that begins with the FIFO's level, this is no sample or one.
    - Every other request: 0 and 0.
    """
    if request[0] != protocol.READ:
        return 0, 0
    return (0, request[3] // _SAMPLE_BYTES) if request[2] in (_LEVEL, _FDATA) else (1, 0)


def reported_free_bytes(request: bytes) -> int | None:
    """Return the free bytes that a memory report contains; None for other requests.

    A memory report gets no answer.
    """
    return _number(request) if request[0] == protocol.MEMORY else None


def busy_us(request: bytes) -> int | None:
    """Return the processor time in us that a `BUSY` request contains; None for other requests.

    A `BUSY` request gets no answer.
    """
    return _number(request) if request[0] == protocol.BUSY else None


def fed_for_us(request: bytes) -> int | None:
    """Return the watchdog's timeout in us for a request that feeds the watchdog; otherwise None."""
    return 1000 * _number(request) if request[0] == protocol.FEED else None


def _number(request: bytes) -> int:
    return int.from_bytes(request[1:4], "little")


def _of(bluetooth: Bluetooth | None) -> Bluetooth:
    if bluetooth is None:
        raise OSError(errno.ENODEV, "no air, so no radio")
    return bluetooth


def answer(
    request: bytes,
    bus: I2CBus,
    usb: UsbHost,
    fd: int,
    rate: float = 1.0,
    second: I2CBus | None = None,
    after_us: float = 0.0,
    bluetooth: Bluetooth | None = None,
) -> None:
    """Execute a request of a board and write its answer to `fd`.

    `rate` is the number of seconds that the board's clock counts in one true second. `after_us` is
    the processor time after a transfer that reads registers. `second` is the bus of a second strip,
    and `bluetooth` the radio. PortError if the pipe is full, because the board does not read its
    answers.
    """
    data, error = b"", 0
    operation, a, b, c = request[:4]
    if second is not None:
        selected = c if operation == protocol.SPEED else a if operation in _ON_A_BUS else 0
        if selected & protocol.SECOND_BUS:
            bus, a = second, a & ~protocol.SECOND_BUS
    try:
        match operation:
            case protocol.READ:
                data = bus.write_read(a, request[2:3], c)
                bus.clock.spend_us(after_us)
            case protocol.SLEEP:
                bus.clock.pause_us(_number(request) / rate)
            case protocol.SPEED:
                bus.frequency_hz = 1000 * int.from_bytes(request[1:3], "little")
            case protocol.RECEIVE:
                data = bus.read(a, c)
            case protocol.LINES:
                data = bytes((bus.lines(a, b),))
            case protocol.LIGHT:
                bus.light(a)
            case protocol.HEAT:
                data = thermometer.read_u16(bus).to_bytes(c, "little")
            case protocol.HID:
                usb.offer(a, request[4:])
            case protocol.BLE:
                radio = _of(bluetooth)
                radio.settle(1e-6 * bus.clock.now_us())
                radio.call(request[4:], bool(a))
            case protocol.BLE_ANSWER:
                data = _of(bluetooth).answer(c)
            case protocol.HOST:
                usb.look()
            case protocol.WRITE:
                bus.write(a, request[4:])
            case protocol.FEED:
                pass  # the caller implements the timeout, see `fed_for_us`
    except OSError as failure:
        error = failure.errno
    now = int(bus.clock.now_us() * rate) % _PERIOD_US
    reply = _ANSWER.pack(error, now) + (b"" if error else data)
    try:
        os.write(fd, reply)  # atomic, because it is shorter than PIPE_BUF
    except BrokenPipeError:
        pass  # the board has ended; the caller detects it at the next request
    except BlockingIOError:
        raise PortError(
            "the virtual board reads no answers to its requests: close it and open it again"
        ) from None
