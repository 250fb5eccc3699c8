"""A virtual board in simulated time, stepped by whoever reads from it.

The board runs only while the host reads: one sensor, scenario and seed give the same bytes every
time, as fast as the machine allows. It is a link as `link.serial_link.SerialLink` is one.
"""

from __future__ import annotations

from collections.abc import Callable

from spots.errors import SpotsError
from spots.link.serial_link import WRITE_TIMEOUT_S, takes_nothing

from .bus import I2CBus, SimulatedClock
from .cpython_board import InProcessBoard
from .faults import BoardFaults, Faults, FaultyBus
from .files import SensorFile
from .identity import board_id
from .piped_board import PipedBoard
from .runtimes import is_cpython
from .usb import UsbHost
from .world import chip


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
        See `vm.MicroPythonProcess`.
    started_s : float
        How long everything but the board's processor has been on: the LED is as warm as then.
    board : str
        See `vm.MicroPythonProcess`.
    faults : faults.Faults, optional
        What goes wrong with bus and board; with the bytes, `faults.FaultyLink` does it.
    busy_us : callable, optional
        ``busy_us(free_bytes)``: what a pass of the board's loop costs its processor, by what is
        free of its heap; spent at each read of registers, on MicroPython alone. Without it the
        processor takes no time.

    Attributes
    ----------
    usb : usb.UsbHost
        The computer that gets the board's USB reports.
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
        self.clock = SimulatedClock(1e6 * started_s)
        self.chip = chip(sensor, scenario, seed)
        bus = I2CBus(self.chip, self.clock)
        if faults:
            bus = FaultyBus(bus, faults)
        board_faults = BoardFaults(faults) if faults else None
        self.usb = UsbHost()
        parts = board_id(sensor), bus, self.usb, board_faults, folder
        self._is_open = True
        self._board = (
            InProcessBoard(*parts) if is_cpython(board) else PipedBoard(*parts, board, busy_us)
        )

    @property
    def bus(self):
        """The board's I2C bus; another one may be put in its place."""
        return self._board.bus

    @bus.setter
    def bus(self, bus) -> None:
        self._board.bus = bus

    @property
    def free_bytes(self) -> int | None:
        """Free heap, as the board reported last; None on CPython."""
        return self._board.free_bytes

    def now_s(self) -> float:
        """Return the simulated time."""
        return self.clock.now_us() * 1e-6

    def read(self, timeout_s: float) -> bytes:
        """Let the board run until it has sent something, at most for `timeout_s`."""
        self._check_open()
        horizon_us = self.clock.now_us() + 1e6 * timeout_s
        while True:
            received = self._board.received()
            if received or self.clock.now_us() >= horizon_us:
                return received
            self._board.step()

    def sleep(self, duration_s: float) -> None:
        """Let the board run unplugged: what it sends is lost."""
        end_us = self.clock.now_us() + 1e6 * duration_s
        while self.clock.now_us() < end_us:
            self._board.step()
        self._board.received()

    def write(self, data: bytes) -> None:
        """Put bytes where the board finds them at its next look; if they do not fit, let it run."""
        self._check_open()
        deadline_us = self.clock.now_us() + 1e6 * WRITE_TIMEOUT_S
        while data := data[self._board.send(data) :]:
            if self.clock.now_us() >= deadline_us:
                raise SpotsError(takes_nothing(self.name))
            self._board.step()

    def close(self) -> None:
        """End the board; closing twice is closing once."""
        self._is_open = False
        self._board.close()

    def _check_open(self) -> None:
        if not self._is_open:
            raise SpotsError("the virtual board was closed")
