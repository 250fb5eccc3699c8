"""A virtual board in MicroPython that runs only while `PipedBoard.step` is called.

The firmware stops at each transfer, sleep and USB report, until `step` answers this request.
"""

from __future__ import annotations

import os
import select
import time
import weakref
from collections.abc import Callable
from pathlib import Path

from spots.deploy.staging import device_of
from spots.errors import PortError

from ..chip.bus import I2CBus
from . import server
from .bluetooth import Bluetooth
from .cpu import Cpu
from .faults import BoardFaults, FaultyBus
from .usb import UsbHost
from .vm import MicroPythonProcess, close_all

_LOOK_MS = 50  # real time without a request, after which the output pipe may be full
_HANGS_S = 60.0  # real time without a request, after which the board counts as hung


class PipedBoard:
    """A virtual board in a separate MicroPython process, with a pair of pipes as serial port.

    `busy_us` is as in `lockstep.LockstepLink`; it can be set to a function only if it was a
    function at the start. `free_bytes` of the heap is None until the board has reported it.
    `second` is the bus of a second strip, `bluetooth` the radio.
    """

    def __init__(
        self,
        board_id: str,
        bus: I2CBus | FaultyBus,
        usb: UsbHost,
        faults: BoardFaults | None,
        folder: Path | None,
        board: str,
        busy_us: Callable[[int], float] | float | None,
        cpu: Cpu | None = None,
        second: I2CBus | FaultyBus | None = None,
        bluetooth: Bluetooth | None = None,
    ):
        self.bus, self._usb, self._faults = bus, usb, faults
        self._rate = faults.rate if faults else 1.0
        self.second, self._bluetooth = second, bluetooth
        self.busy_us = busy_us
        self.free_bytes: int | None = None
        board_in, self._to_board = os.pipe()
        self._from_board, board_out = os.pipe()
        os.set_blocking(self._from_board, False)
        # Unlike os.read, this reads an empty pipe without an exception.
        self._output = open(self._from_board, "rb", buffering=0, closefd=False)
        self._buffer = memoryview(bytearray(1 << 16))
        os.set_blocking(self._to_board, False)
        self._sent = b""  # read from the full pipe, so that the board can continue
        self._board_in = board_in
        self._open = [board_in, self._to_board, self._from_board, board_out]
        self._close_pipes = weakref.finalize(self, close_all, self._open)
        self._close_pipes.atexit = False  # as in `MicroPythonProcess`
        stdin, data = board_in, None
        if device_of(board).runtime == "circuitpython":
            # The console has no input; its output is sent with the frames.
            stdin, data = os.open(os.devnull, os.O_RDONLY), (board_in, board_out)
            self._open.append(stdin)
        self._machine = MicroPythonProcess(
            board_id,
            True,
            stdin,
            board_out,
            folder,
            board,
            data=data,
            reports_memory=callable(busy_us),
            cpu=cpu,
            strips=2 if second else 1,
        )
        self._polled = -1  # the pipe in `_poll`
        self._pending = self._next_request()

    def send(self, data: bytes) -> int:
        """Send bytes to the board; return how many of them the pipe accepted."""
        try:
            return os.write(self._to_board, data)
        except BlockingIOError:
            return 0

    def received(self) -> bytes:
        """Return all bytes that the board has sent since the last call."""
        size = self._output.readinto(self._buffer)
        if not size and not self._sent:
            return b""
        sent, self._sent = self._sent, b""
        return sent + self._buffer[: size or 0]

    def step(self) -> None:
        """Answer the firmware's pending request, and run the firmware until its next request."""
        off_us = self._faults.step(self.bus) if self._faults else None
        if off_us is None:
            after_us = 0.0
            if self.busy_us and any(passes := server.passes(self._pending)):
                busy_us = self.busy_us
                lasted_us = busy_us(self.free_bytes) if callable(busy_us) else busy_us
                self.bus.clock.spend_us(passes[0] * lasted_us)
                after_us = passes[1] * lasted_us
            answers = self._machine.answers
            server.answer(
                self._pending,
                self.bus,
                self._usb,
                answers,
                self._rate,
                self.second,
                after_us,
                self._bluetooth,
            )
        else:
            self._brown_out(off_us)
        self._pending = self._next_request()

    def close(self) -> None:
        """Stop the board; a second call has no effect."""
        self._machine.close()
        self._close_pipes()

    def _brown_out(self, off_us: float) -> None:
        self._machine.shut_down()
        if select.select([self._board_in], [], [], 0)[0]:
            os.read(self._board_in, 1 << 16)  # a board without power loses bytes it has not read
        self.bus.clock.pause_us(off_us)
        for bus in filter(None, (self.bus, self.second)):
            bus.chip.power_on(bus.clock.now_us())
        self._machine.boot()

    def _next_request(self) -> bytes:
        for _ in range(3):
            request = self._request()
            while request and self._is_report(request):
                request = self._request()
            if request is None:
                self._machine.ended(self.received())
            elif not server.is_reset(request):
                return request
            self._machine.boot()
        raise PortError(
            "the virtual board restarts again and again: check main.py and what it prints"
        )

    def _is_report(self, request: bytes) -> bool:
        """Process a report of the board; return False for a request, which needs an answer."""
        if request[0] not in server.REPORTS:
            return False
        if (free_bytes := server.reported_free_bytes(request)) is not None:
            self.free_bytes = free_bytes
        elif (busy_us := server.busy_us(request)) is not None:
            self.bus.clock.spend_us(busy_us / self._rate)
        return True

    def _request(self) -> bytes | None:
        requests = self._machine.requests
        if requests != self._polled:  # the board has booted
            self._polled, self._poll = requests, select.poll()
            self._poll.register(requests, select.POLLIN)
        hangs_s = None
        while not self._poll.poll(_LOOK_MS):
            # A board whose output pipe is full makes no request until the pipe is read.
            self._sent = self.received()
            hangs_s = hangs_s or time.monotonic() + _HANGS_S
            if time.monotonic() >= hangs_s:
                raise PortError(
                    f"the virtual board hangs: no request for {_HANGS_S:.0f} s; open it again"
                )
        return server.read_request(requests)
