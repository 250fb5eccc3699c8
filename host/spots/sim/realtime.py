"""A virtual board in real time: a process of its own with PTYs that pyserial opens.

Run as ``python -m spots.sim.realtime SENSOR SCENARIO SEED BOARD FOLDER``. FOLDER is the board's
file system, used as it is; where it is empty, a new one gets the firmware. It prints one JSON
object: the ports for frames and for the prompt, which are one but on CircuitPython, and the host's
monotonic time of power-on. It lives until its standard input closes, so that it never outlives
whoever started it.
"""

from __future__ import annotations

import contextlib
import json
import os
import pty
import select
import sys
import time
import tty
from pathlib import Path

from ..errors import SpotsError
from ..stage import device_of
from . import server
from .bus import Bus
from .files import ScenarioFile, SensorFile, load
from .identity import board_id
from .scenario import Scenario
from .usb import UsbHost
from .vm import Machine
from .world import chip

_RAW_PROMPT, _FRIENDLY_PROMPT = 1, 2  # Ctrl-A and Ctrl-B


class RealClock:
    """The host's monotonic clock; transfers take the time that they take."""

    def __init__(self):
        self.started_s = time.monotonic()

    def now_us(self) -> float:
        return (time.monotonic() - self.started_s) * 1e6

    def spend_us(self, duration_us: float) -> None:
        pass


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
        self._to_board, self.board_in = pty.openpty()
        tty.setraw(self.board_in)
        self.raw_prompt = False

    def pass_on(self) -> None:
        """Give the board what the host has written."""
        data = os.read(self.board_end, 4096)
        modes = [byte for byte in data if byte in (_RAW_PROMPT, _FRIENDLY_PROMPT)]
        if modes:
            self.raw_prompt = modes[-1] == _RAW_PROMPT
        os.write(self._to_board, data)

    def after_soft_reset(self) -> None:
        """Say what a board says, and go back to the raw prompt if that is where it was."""
        os.write(self.board_end, b"MPY: soft reboot\r\n")
        if self.raw_prompt:
            os.write(self._to_board, bytes((_RAW_PROMPT,)))


def main(sensor_name: str, scenario_name: str, seed: int, board: str, folder: str) -> None:
    """Serve a board until standard input closes."""
    sensor = load(SensorFile, sensor_name)
    scenario = Scenario(load(ScenarioFile, scenario_name))
    console = Console()
    data = SerialPort() if device_of(board).runtime == "circuitpython" else None
    clock = RealClock()
    bus, usb = Bus(chip(sensor, scenario, seed), clock), UsbHost()
    machine = Machine(
        board_id(sensor),
        False,
        console.board_in,
        console.board_end,
        folder=Path(folder) if folder else None,
        board=board,
        blank=bool(folder),
        terminal=True,
        data=data and (data.board_end, data.board_end),
    )
    start = {
        "port": (data or console).name,
        "console": console.name,
        "started_s": clock.started_s,
    }
    try:
        print(json.dumps(start), flush=True)
        _serve(machine, bus, usb, console)
    finally:
        machine.close()


def _serve(machine: Machine, bus: Bus, usb: UsbHost, console: Console) -> None:
    stdin = sys.stdin.fileno()
    while True:
        ready, _, _ = select.select([machine.requests, stdin, console.board_end], [], [])
        if stdin in ready and not os.read(stdin, 1):
            return
        if console.board_end in ready:
            console.pass_on()
        if machine.requests in ready:
            request = server.read_request(machine.requests)
            if request is None:
                machine.ended()
                machine.boot(run_entry=not console.raw_prompt)
                console.after_soft_reset()
            elif server.is_reset(request):
                machine.boot()
            else:
                server.answer(request, bus, usb, machine.answers)


if __name__ == "__main__":
    try:
        with contextlib.suppress(KeyboardInterrupt):
            main(sys.argv[1], sys.argv[2], int(sys.argv[3]), *sys.argv[4:6])
    except SpotsError as error:
        print(json.dumps({"error": str(error)}), flush=True)
        sys.exit(2)
