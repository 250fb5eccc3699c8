"""A virtual board in simulated time, which runs only during calls of `LockstepLink`.

The same sensor, scenario and seed give the same bytes in each run.
"""

from __future__ import annotations

from collections.abc import Callable

from spots.errors import ClosedError, PortError
from spots.link.serial_link import WRITE_TIMEOUT_S, takes_nothing

from ..chip.bus import I2CBus, SimulatedClock
from ..strip.files import SensorFile
from ..strip.world import chip
from .bluetooth import Air, Bluetooth
from .cpu import load as load_cpu
from .cpython_board import InProcessBoard
from .faults import BoardFaults, Faults, FaultyBus
from .identity import board_id
from .piped_board import PipedBoard
from .runtimes import is_cpython
from .usb import UsbHost


class LockstepLink:
    """The serial port of a virtual board in simulated time, as a `spots.link.link.Link`.

    It never raises PortLostError, so it has no methods to open its port again. Time 0 of the
    scenario is power-on; the firmware starts at `started_s`. Without `folder`, the board's file
    system is a temporary folder with the firmware. `faults` are those of bus and board; for damaged
    or lost bytes, use `faults.FaultyLink`. With `warm`, the LED has its final temperature from the
    start.

    `busy_us` is the processor time of one loop pass, on MicroPython only. The time passes before
    each read of registers except those of the FIFO. After a read of the FIFO, it passes for each
    sample that was read. With a function ``busy_us(free_bytes) -> float``, the board reports its
    number of free heap bytes at each transfer, which doubles the run time. `cpu` names a processor,
    see `cpu.load`. By default, only transfers and sleeps take time.

    `second` is the scenario and the seed of a second strip, with the same sensor file. `number` is
    that of `identity.board_id`. `usb` is the computer that gets the board's USB reports. With
    `air`, the board has a radio, `bluetooth`.
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
        busy_us: Callable[[int], float] | float | None = None,
        warm: bool = False,
        cpu: str | None = None,
        second: tuple | None = None,
        number: int = 0,
        air: Air | None = None,
    ):
        slow = load_cpu(cpu, board) if cpu else None
        self.clock = SimulatedClock(1e6 * started_s)
        self.chip = chip(sensor, scenario, seed, warm)
        call_us = slow.transfer_us() if slow else 0.0
        bus = I2CBus(self.chip, self.clock, call_us=call_us)
        if faults:
            bus = FaultyBus(bus, faults)
        board_faults = BoardFaults(faults) if faults else None
        self.usb = UsbHost()
        other = I2CBus(chip(sensor, *second, warm), self.clock, call_us=call_us) if second else None
        self.bluetooth = Bluetooth(air) if air else None
        parts = board_id(sensor, number), bus, self.usb, board_faults, folder
        self._is_open = True
        self._board = (
            InProcessBoard(*parts, slow, other, self.bluetooth)
            if is_cpython(board)
            else PipedBoard(*parts, board, busy_us, slow, other, self.bluetooth)
        )

    @property
    def bus(self):
        """The board's I2C bus; assign another bus to replace it."""
        return self._board.bus

    @bus.setter
    def bus(self, bus) -> None:
        self._board.bus = bus

    @property
    def second(self):
        """I2C bus of the board's second strip; assign another bus to replace it."""
        return self._board.second

    @second.setter
    def second(self, bus) -> None:
        self._board.second = bus

    def set_busy_us(self, busy_us: float) -> None:
        """Set the processor time of one loop pass in us; no effect on CPython."""
        self._board.busy_us = busy_us

    @property
    def free_bytes(self) -> int | None:
        """Free bytes of the heap, as last reported by the board; None on CPython."""
        return self._board.free_bytes

    def now_s(self) -> float:
        """Return the simulated time in seconds."""
        return self.clock.now_us() * 1e-6

    def read(self, timeout_s: float) -> bytes:
        """Run the board until it sends data, for at most `timeout_s` seconds; return the data."""
        self._check_open()
        horizon_us = self.clock.now_us() + 1e6 * timeout_s
        while True:
            received = self._board.received()
            if received or self.clock.now_us() >= horizon_us:
                return received
            self._board.step()

    def run_once(self) -> None:
        """Run one step of the board, which keeps the data that it sends."""
        self._board.step()

    def sleep(self, duration_s: float) -> None:
        """Run the board for `duration_s` seconds, and discard the data that the board sends."""
        end_us = self.clock.now_us() + 1e6 * duration_s
        while self.clock.now_us() < end_us:
            self._board.step()
        self._board.received()

    def write(self, data: bytes) -> None:
        """Send bytes to the board; while its buffer is full, run the board."""
        self._check_open()
        deadline_us = self.clock.now_us() + 1e6 * WRITE_TIMEOUT_S
        while data := data[self._board.send(data) :]:
            if self.clock.now_us() >= deadline_us:
                raise PortError(takes_nothing(self.name))
            self._board.step()

    def close(self) -> None:
        """Stop the board; a second call has no effect."""
        self._is_open = False
        self._board.close()

    def _check_open(self) -> None:
        if not self._is_open:
            raise ClosedError("the virtual board is closed: open it again")
