"""A virtual board in simulated time, stepped by whoever reads from it.

Nothing runs but what a read lets run: MicroPython is always held at a bus request while the host
thinks, so that one sensor, scenario and seed give the same bytes every time, as fast as the
machine allows. It is a link as `link.serial_link.SerialLink` is one.
"""

from __future__ import annotations

import os
import select
import time
from collections.abc import Callable

from spots.deploy.staging import device_of
from spots.errors import SpotsError
from spots.link.serial_link import WRITE_TIMEOUT_S, takes_nothing

from . import server
from .bus import Bus, SimulatedClock
from .faults import BoardFaults, Faults, FaultyBus
from .files import SensorFile
from .identity import board_id
from .usb import UsbHost
from .vm import Machine, micropython_command
from .world import chip

_LOOK_S = 0.05  # real time, after which a board that asks for nothing may wait to be read
_HANGS_S = 60.0  # real time, in which a board that runs asks for something


class LockstepLink:
    """The serial port of a virtual board in simulated time.

    Parameters
    ----------
    sensor : files.SensorFile
    scenario : scenario.Scenario or scenario.Held
        Time 0 is power-on.
    seed : int
        Of all noise.
    folder : Path, optional
        See `vm.Machine`.
    started_s : float
        How long everything but the board's processor has been on: the LED is as warm as then.
    board : str
        See `vm.Machine`.
    faults : faults.Faults, optional
        What goes wrong with bus and board; with the bytes, `faults.FaultyLink` does it.
    busy_us : callable, optional
        ``busy_us(free_bytes)``: what a pass of the board's loop costs its processor, by what is
        free of its heap; spent at each read of registers. Without it the processor takes no time.

    Attributes
    ----------
    usb : usb.UsbHost
        The computer that gets the board's USB reports.
    free_bytes : int or None
        Of the board's heap, as it told last.
    """

    name = "virtual"

    def __init__(
        self,
        sensor: SensorFile,
        scenario,
        seed: int = 0,
        folder=None,
        started_s: float = 0.0,
        board: str = "virtual",
        faults: Faults | None = None,
        busy_us: Callable[[int], float] | None = None,
    ):
        micropython_command()  # fails before anything is open
        self._busy_us = busy_us
        self.clock = SimulatedClock(1e6 * started_s)
        self.chip = chip(sensor, scenario, seed)
        self.bus = Bus(self.chip, self.clock)
        if faults:
            self.bus = FaultyBus(self.bus, faults)
        self._faults = BoardFaults(faults) if faults else None
        self._rate = self._faults.rate if faults else 1.0
        self.usb = UsbHost()
        self.free_bytes: int | None = None
        board_in, self._to_board = os.pipe()
        self._from_board, board_out = os.pipe()
        os.set_blocking(self._from_board, False)
        os.set_blocking(self._to_board, False)
        self._sent = b""  # taken out of the pipe, so that the board can go on
        self._board_in = board_in
        self._open = [board_in, self._to_board, self._from_board, board_out]
        stdin, data = board_in, None
        if device_of(board).runtime == "circuitpython":
            # Nobody types at its console; what it says there is told with the frames.
            stdin, data = os.open(os.devnull, os.O_RDONLY), (board_in, board_out)
            self._open.append(stdin)
        self._machine = Machine(
            board_id(sensor),
            True,
            stdin,
            board_out,
            folder,
            board,
            data=data,
            tells_memory=busy_us is not None,
        )
        self._pending = self._next_request()

    def now_s(self) -> float:
        """Return the simulated time."""
        return self.clock.now_us() * 1e-6

    def read(self, timeout_s: float) -> bytes:
        """Let the board run until it has sent something, at most for `timeout_s`."""
        if not self._open:
            raise SpotsError("the virtual board was closed")
        horizon_us = self.clock.now_us() + 1e6 * timeout_s
        while True:
            received = self._received()
            if received or self.clock.now_us() >= horizon_us:
                return received
            self._step()

    def sleep(self, duration_s: float) -> None:
        """Let the board run unplugged: nobody reads what it sends meanwhile."""
        end_us = self.clock.now_us() + 1e6 * duration_s
        while self.clock.now_us() < end_us:
            self._step()
        self._received()

    def write(self, data: bytes) -> None:
        """Put bytes where the board finds them at its next look; if they do not fit, let it run."""
        if not self._open:
            raise SpotsError("the virtual board was closed")
        deadline_us = self.clock.now_us() + 1e6 * WRITE_TIMEOUT_S
        while data:
            try:
                data = data[os.write(self._to_board, data) :]
            except BlockingIOError:
                if self.clock.now_us() >= deadline_us:
                    raise SpotsError(takes_nothing(self.name)) from None
                self._step()

    def close(self) -> None:
        """End the board; closing twice is closing once."""
        self._machine.close()
        while self._open:
            os.close(self._open.pop())

    def _step(self) -> None:
        off_us = self._faults.step(self.bus) if self._faults else None
        if off_us is None:
            if self._busy_us and server.is_poll(self._pending):
                self.clock.spend_us(self._busy_us(self.free_bytes))
            answers = self._machine.answers
            server.answer(self._pending, self.bus, self.usb, answers, self._rate)
        else:
            self._brown_out(off_us)
        self._pending = self._next_request()

    def _brown_out(self, off_us: float) -> None:
        self._machine.shut_down()
        if select.select([self._board_in], [], [], 0)[0]:
            os.read(self._board_in, 1 << 16)  # what it had not read is gone
        self.clock.pause_us(off_us)
        self.chip.power_on(self.clock.now_us())
        self._machine.boot()

    def _next_request(self) -> bytes:
        for _ in range(3):
            request = self._request()
            while request and (free_bytes := server.told_free_bytes(request)) is not None:
                self.free_bytes = free_bytes
                request = self._request()
            if request is None:
                self._machine.ended(self._received())
            elif not server.is_reset(request):
                return request
            self._machine.boot()
        raise SpotsError("the virtual board reboots without end")

    def _request(self) -> bytes | None:
        deadline_s = time.monotonic() + _HANGS_S
        while not select.select([self._machine.requests], [], [], _LOOK_S)[0]:
            # A board that has more to send than the pipe takes asks for nothing before it is sent.
            self._sent = self._received()
            if time.monotonic() >= deadline_s:
                raise SpotsError(f"the virtual board hangs: no request for {_HANGS_S:.0f} s")
        return server.read_request(self._machine.requests)

    def _received(self) -> bytes:
        sent, self._sent = self._sent, b""
        try:
            return sent + os.read(self._from_board, 1 << 16)
        except BlockingIOError:
            return sent
