"""A virtual board in real time: a process of its own with PTYs that pyserial opens.

Run as ``python -m spots_sim.realtime SENSOR SCENARIO SEED BOARD FOLDER``. FOLDER is the board's
file system, used as it is; where it is empty, a new one gets the firmware. It prints one JSON
object: the ports for frames and for the prompt, which are one but on CircuitPython, and the host's
monotonic time of power-on. It lives until its standard input closes or its parent ends, whatever it
does just then, so that it never outlives whoever started it.
"""

from __future__ import annotations

import contextlib
import math
import os
import pty
import select
import sys
import threading
import time
import tty
from pathlib import Path

from spots.deploy.staging import device_of
from spots.errors import SpotsError

from . import server
from .bus import I2CBus, RealClock
from .faults import BoardFaults, Faults, FaultyBus, of_scenario
from .files import ScenarioFile, SensorFile, load
from .identity import board_id
from .scenario import Scenario
from .starting import report
from .usb import UsbHost
from .vm import MicroPythonProcess
from .world import chip

_RAW_PROMPT, _FRIENDLY_PROMPT = 1, 2  # Ctrl-A and Ctrl-B

_STUCK_S = 0.002  # between two tries to write what a reader has no room for
_PARENT_EVERY_S = 0.5  # between two looks whether the parent is there
_END_S = 5.0  # for the board to end cleanly once the parent has


class Inlet:
    """A descriptor to write to, and what its reader has no room for yet; never blocks.

    Parameters
    ----------
    fd : int

    Attributes
    ----------
    stuck : bool
        Whether something waits. Give it no more then, so that no more waits than one read's worth.
    """

    def __init__(self, fd: int):
        os.set_blocking(fd, False)
        self._fd = fd
        self._waiting = b""

    @property
    def stuck(self) -> bool:
        return bool(self._waiting)

    def write(self, data: bytes = b"") -> None:
        """Write what waits and this, as far as there is room."""
        self._waiting += data
        with contextlib.suppress(BlockingIOError):
            self._waiting = self._waiting[os.write(self._fd, self._waiting) :]


class SerialPort:
    """A USB serial port: its host's end, by name, and the board's.

    Raw before anyone opens it: a terminal would echo the board's frames back as commands. The
    host's end stays open here, so that the board sees no hang-up between two readers.
    """

    def __init__(self):
        self.board_end, host_end = pty.openpty()
        tty.setraw(host_end)
        os.set_blocking(self.board_end, False)
        self.name = os.ttyname(host_end)


class Console(SerialPort):
    """The port with the prompt.

    What the host writes passes through a terminal of MicroPython's own, since it has a prompt
    only on one.
    """

    def __init__(self):
        super().__init__()
        to_board, self.board_in = pty.openpty()
        tty.setraw(self.board_in)
        self.to_board = Inlet(to_board)
        self.raw_prompt = False

    def pass_on(self, damaged) -> None:
        """Give the board what the host has written, changed by ``damaged(data)``."""
        data = damaged(os.read(self.board_end, 4096))
        modes = [byte for byte in data if byte in (_RAW_PROMPT, _FRIENDLY_PROMPT)]
        if modes:
            self.raw_prompt = modes[-1] == _RAW_PROMPT
        self.to_board.write(data)

    def after_soft_reset(self) -> None:
        """Print a board's message, and return to the raw prompt if it was there."""
        with contextlib.suppress(BlockingIOError):  # nobody reads it
            os.write(self.board_end, b"MPY: soft reboot\r\n")
        if self.raw_prompt:
            self.to_board.write(bytes((_RAW_PROMPT,)))


class PortNoise:
    """Damages the bytes between a board and the port for its frames, as a scenario says.

    The board writes into a pipe and, where the port is not its console, reads from another one.

    Parameters
    ----------
    faults : faults.Faults
    clock : RealClock
    port : SerialPort
        The port for frames.
    """

    def __init__(self, faults: Faults, clock: RealClock, port: SerialPort):
        self._faults = faults
        self._clock = clock
        self._port_end = port.board_end
        self.from_board, self.board_out = os.pipe()
        self.board_in, to_board = os.pipe()
        self.to_board, self.to_host = Inlet(to_board), Inlet(self._port_end)

    def damaged(self, data: bytes) -> bytes:
        """Return what arrives at the board."""
        return self._faults.to_board(data, self._clock.now_us())

    def pass_in(self) -> None:
        """Give the board what the host has written to a port for frames alone."""
        self.to_board.write(self.damaged(os.read(self._port_end, 4096)))

    def pass_out(self) -> None:
        """Give the host what the board has sent."""
        data = os.read(self.from_board, 4096)
        self.to_host.write(self._faults.to_host(data, self._clock.now_us()))


def main(sensor_name: str, scenario_name: str, seed: int, board: str, folder: str) -> None:
    """Serve a board until standard input closes or the parent ends.

    Parameters
    ----------
    sensor_name, scenario_name : str
        Sensor and scenario file: a path or a name.
    seed : int
        Random seed of noise and faults.
    board : str
        A name that ``spots boards`` lists.
    folder : str
        The board's file system.

    Raises
    ------
    SpotsError
        If a file is missing or invalid.
    """
    parent_end = _end_of_parent()
    sensor = load(SensorFile, sensor_name)
    file = load(ScenarioFile, scenario_name)
    scenario = Scenario(file)
    console = Console()
    data = SerialPort() if device_of(board).runtime == "circuitpython" else None
    clock = RealClock()
    bus, usb = I2CBus(chip(sensor, scenario, seed), clock), UsbHost()
    noise = board_faults = None
    faults = of_scenario(file, seed)
    if faults:
        noise, board_faults = PortNoise(faults, clock, data or console), BoardFaults(faults)
        bus = FaultyBus(bus, faults)
    frames_out = noise.board_out if noise else (data or console).board_end
    machine = MicroPythonProcess(
        board_id(sensor),
        False,
        console.board_in,
        console.board_end if data else frames_out,
        folder=Path(folder) if folder else None,
        board=board,
        blank=bool(folder),
        terminal=True,
        data=data and (noise.board_in if noise else data.board_end, frames_out),
        rate=board_faults.rate if board_faults else 1.0,
    )
    start = {
        "port": (data or console).name,
        "console": console.name,
        "started_s": clock.started_s,
    }
    try:
        report(start)
        _serve(parent_end, machine, bus, usb, console, data, noise, board_faults)
    finally:
        machine.close()


def _end_of_parent() -> int:
    """Return a descriptor that ends with the parent.

    A thread detects it, and ends the process if the main thread does not in time; the keeper of
    MicroPython then ends that. The thread is not guarded: its failure ends the process too.
    """
    parent, stdin = os.getppid(), sys.stdin.fileno()
    gone, there = os.pipe()

    def watch():
        try:
            # Another process may have inherited the pipe and keep it open after the parent ends.
            while os.getppid() == parent:
                if select.select([stdin], [], [], _PARENT_EVERY_S)[0] and not os.read(stdin, 1):
                    break
        finally:
            os.close(there)
            time.sleep(_END_S)
            os._exit(1)

    threading.Thread(target=watch, daemon=True).start()
    return gone


def _serve(
    parent_end: int,
    machine: MicroPythonProcess,
    bus: I2CBus | FaultyBus,
    usb: UsbHost,
    console: Console,
    data: SerialPort | None,
    noise: PortNoise | None,
    board_faults: BoardFaults | None,
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
    starved_us = math.inf  # when the watchdog resets the board
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
            fed_us = server.fed_for_us(request or b"")
            if fed_us is not None:
                starved_us = bus.clock.now_us() + fed_us
            off_us = board_faults.step(bus) if board_faults else None
            if off_us is not None:
                machine.shut_down()
                bus.clock.pause_us(off_us)
                bus.chip.power_on(bus.clock.now_us())
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
                server.answer(request, bus, usb, machine.answers)


def _timeout_s(bus: I2CBus | FaultyBus, stuck: bool, starved_us: float) -> float | None:
    if stuck:
        return _STUCK_S
    if starved_us < math.inf:
        return max(0.0, (starved_us - bus.clock.now_us()) * 1e-6)
    return None


if __name__ == "__main__":
    try:
        with contextlib.suppress(KeyboardInterrupt):
            main(sys.argv[1], sys.argv[2], int(sys.argv[3]), *sys.argv[4:6])
    except SpotsError as error:
        report({"error": str(error)})
        sys.exit(2)
