"""A virtual board in real time: a process with pseudo-terminals that pyserial opens.

Run it as ``python -m spots_sim.board.realtime SENSOR SCENARIO SEED BOARD FOLDER STRIPS``. FOLDER is
the board's file system, firmware included. If FOLDER is an empty string, a temporary folder is made
and the firmware copied to it. STRIPS is 1 or 2; the second strip has the same sensor and scenario.

The process prints one JSON object: the port for frames, the port for the prompt, and the host's
monotonic time of power-on. The two ports differ only on CircuitPython. The process ends when its
standard input closes or its parent ends.
"""

from __future__ import annotations

import contextlib
import fcntl
import math
import os
import pty
import select
import sys
import tty
from pathlib import Path

from spots.deploy.staging import device_of
from spots.errors import SpotsError

from ..chip.bus import I2CBus, RealClock
from ..strip.files import ScenarioFile, SensorFile, load
from ..strip.scenario import Scenario
from ..strip.world import chip
from . import server
from .faults import BoardFaults, Faults, FaultyBus, of_scenario
from .identity import board_id
from .starting import PseudoTerminal, report, when_parent_ends
from .usb import UsbHost
from .vm import MicroPythonProcess

_RAW_PROMPT, _FRIENDLY_PROMPT = 1, 2  # Ctrl-A and Ctrl-B

_STUCK_S = 0.002  # interval between two attempts to write to a full pipe


class Inlet:
    """Writes to a file descriptor without blocking, and buffers the bytes that do not fit.

    While `stuck`, bytes are buffered. Then write no new bytes: the buffer's size is not limited.
    """

    def __init__(self, fd: int):
        os.set_blocking(fd, False)
        self._fd = fd
        self._waiting = b""

    @property
    def stuck(self) -> bool:
        return bool(self._waiting)

    def write(self, data: bytes = b"") -> None:
        """Write the buffered bytes, then `data`; buffer what the reader does not accept yet."""
        self._waiting += data
        with contextlib.suppress(BlockingIOError):
            self._waiting = self._waiting[os.write(self._fd, self._waiting) :]


class Console(PseudoTerminal):
    """The simulated board's port that has the MicroPython prompt.

    It consists of two pseudo-terminals: one for the host and one for MicroPython, which shows a
    prompt only on a terminal.
    """

    def __init__(self):
        super().__init__()
        to_board, self.board_in = pty.openpty()
        # A program whose board is gone may search at this name, and would take the host's bytes.
        fcntl.flock(self.board_in, fcntl.LOCK_EX)
        tty.setraw(self.board_in)
        self.to_board = Inlet(to_board)
        self.raw_prompt = False

    def pass_on(self, damaged) -> None:
        """Pass the host's bytes to the board; ``damaged(data)`` returns the bytes that arrive."""
        data = damaged(os.read(self.board_end, 4096))
        modes = [byte for byte in data if byte in (_RAW_PROMPT, _FRIENDLY_PROMPT)]
        if modes:
            self.raw_prompt = modes[-1] == _RAW_PROMPT
        self.to_board.write(data)

    def after_soft_reset(self) -> None:
        """Print MicroPython's message of a soft reset; restore the raw prompt if it was active."""
        with contextlib.suppress(BlockingIOError):  # no program reads the port
            os.write(self.board_end, b"MPY: soft reboot\r\n")
        if self.raw_prompt:
            self.to_board.write(bytes((_RAW_PROMPT,)))


class PortNoise:
    """Damages the bytes between a board and its port for frames.

    The board writes its bytes into a pipe. If the port is not also the board's console, the board
    reads the host's bytes from a second pipe.
    """

    def __init__(self, faults: Faults, clock: RealClock, port: PseudoTerminal):
        self._faults = faults
        self._clock = clock
        self._port_end = port.board_end
        self.from_board, self.board_out = os.pipe()
        self.board_in, to_board = os.pipe()
        self.to_board, self.to_host = Inlet(to_board), Inlet(self._port_end)

    def damaged(self, data: bytes) -> bytes:
        """Return the bytes that arrive at the board if the host sends `data` now."""
        return self._faults.to_board(data, self._clock.now_us())

    def pass_in(self) -> None:
        """Damage the host's bytes and send them to the board; not for a port with the console."""
        self.to_board.write(self.damaged(os.read(self._port_end, 4096)))

    def pass_out(self) -> None:
        """Damage the board's bytes and send them to the host."""
        data = os.read(self.from_board, 4096)
        self.to_host.write(self._faults.to_host(data, self._clock.now_us()))


def main(
    sensor_name: str, scenario_name: str, seed: int, board: str, folder: str, strips: int
) -> None:
    """Run a virtual board until standard input closes or the parent ends.

    The arguments are those of the command line, see the module. SpotsError if a file is missing or
    invalid.
    """
    parent_end, open_end = os.pipe()  # `parent_end` is readable after the parent ends
    when_parent_ends(lambda: os.close(open_end))
    sensor = load(SensorFile, sensor_name)
    file = load(ScenarioFile, scenario_name)
    scenario = Scenario(file)
    console = Console()
    data = PseudoTerminal() if device_of(board).runtime == "circuitpython" else None
    clock = RealClock()
    bus, usb = I2CBus(chip(sensor, scenario, seed), clock), UsbHost()
    second = I2CBus(chip(sensor, scenario, seed + 1), clock) if strips > 1 else None
    noise = board_faults = None
    faults = of_scenario(file, seed)
    if faults:
        noise, board_faults = PortNoise(faults, clock, data or console), BoardFaults(faults)
        bus = FaultyBus(bus, faults)
    frames_out = noise.board_out if noise else (data or console).board_end
    machine = MicroPythonProcess(
        board_id(sensor, seed),
        False,
        console.board_in,
        console.board_end if data else frames_out,
        folder=Path(folder) if folder else None,
        board=board,
        blank=bool(folder),
        terminal=True,
        data=data and (noise.board_in if noise else data.board_end, frames_out),
        rate=board_faults.rate if board_faults else 1.0,
        strips=strips,
    )
    start = {
        "port": (data or console).name,
        "console": console.name,
        "started_s": clock.started_s,
    }
    try:
        report(start)
        _serve(parent_end, machine, bus, usb, console, data, noise, board_faults, second)
    finally:
        machine.close()


def _serve(
    parent_end: int,
    machine: MicroPythonProcess,
    bus: I2CBus | FaultyBus,
    usb: UsbHost,
    console: Console,
    data: PseudoTerminal | None,
    noise: PortNoise | None,
    board_faults: BoardFaults | None,
    second: I2CBus | None,
) -> None:
    # Source, target and copy function. A source is not read while its target is full.
    passages = {console.board_end: (console.to_board, lambda: console.pass_on(bytes))}
    if noise:
        passages[noise.from_board] = noise.to_host, noise.pass_out
        if data:
            passages[data.board_end] = noise.to_board, noise.pass_in
        else:
            pass_on = console.to_board, lambda: console.pass_on(noise.damaged)
            passages[console.board_end] = pass_on
    starved_us = math.inf  # time at which the watchdog resets the board
    while True:
        ends = [end for end, (inlet, _) in passages.items() if not inlet.stuck]
        timeout_s = _timeout_s(bus, len(ends) < len(passages), starved_us)
        ready, _, _ = select.select([machine.requests, parent_end, *ends], [], [], timeout_s)
        if parent_end in ready:
            return
        for end, (inlet, pass_on) in passages.items():
            if inlet.stuck:
                inlet.write()
            elif end in ready:
                pass_on()
        if bus.clock.now_us() > starved_us:
            starved_us = math.inf
            machine.boot()
        elif machine.requests in ready:
            request = server.read_request(machine.requests)
            fed_us = server.fed_for_us(request) if request else None
            if fed_us is not None:
                starved_us = bus.clock.now_us() + fed_us
            off_us = board_faults.step(bus) if board_faults else None
            if off_us is not None:
                machine.shut_down()
                bus.clock.pause_us(off_us)
                for powered in filter(None, (bus, second)):
                    powered.chip.power_on(bus.clock.now_us())
                machine.boot()
                starved_us = math.inf
            elif request is None:
                machine.ended()
                machine.boot(run_entry=not console.raw_prompt)
                console.after_soft_reset()
            elif server.is_reset(request):
                machine.boot()
                starved_us = math.inf
            else:
                server.answer(request, bus, usb, machine.answers, second=second)


def _timeout_s(bus: I2CBus | FaultyBus, stuck: bool, starved_us: float) -> float | None:
    if stuck:
        return _STUCK_S
    if starved_us < math.inf:
        return max(0.0, (starved_us - bus.clock.now_us()) * 1e-6)
    return None


if __name__ == "__main__":
    try:
        with contextlib.suppress(KeyboardInterrupt):
            main(sys.argv[1], sys.argv[2], int(sys.argv[3]), *sys.argv[4:6], int(sys.argv[6]))
    except SpotsError as error:
        report({"error": str(error)})
        sys.exit(2)
