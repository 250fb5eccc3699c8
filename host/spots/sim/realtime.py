"""A virtual board in real time: a process of its own with a PTY that pyserial opens.

Run as ``python -m spots.sim.realtime SENSOR SCENARIO SEED BOARD FOLDER``. FOLDER is the board's
file system, used as it is; where it is empty, a new one gets the firmware. It prints one JSON
object, the port and the host's monotonic time of power-on, and lives until its standard input
closes, so that it never outlives whoever started it.
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
    """The board's USB serial port: what the host opens, and what MicroPython has for it.

    What the host writes passes through a terminal of MicroPython's own, since it has a prompt
    only on one.
    """

    def __init__(self):
        self.from_host, self._host_end = pty.openpty()
        self._to_board, self.board_in = pty.openpty()
        # Raw before anyone opens it: a terminal would echo the board's frames back as commands.
        # The host's end stays open here, so that the board sees no hang-up between two readers.
        tty.setraw(self._host_end)
        tty.setraw(self.board_in)
        os.set_blocking(self.from_host, False)
        self.name = os.ttyname(self._host_end)
        self.raw_prompt = False

    def pass_on(self) -> None:
        """Give the board what the host has written."""
        data = os.read(self.from_host, 4096)
        modes = [byte for byte in data if byte in (_RAW_PROMPT, _FRIENDLY_PROMPT)]
        if modes:
            self.raw_prompt = modes[-1] == _RAW_PROMPT
        os.write(self._to_board, data)

    def after_soft_reset(self) -> None:
        """Say what a board says, and go back to the raw prompt if that is where it was."""
        os.write(self.from_host, b"MPY: soft reboot\r\n")
        if self.raw_prompt:
            os.write(self._to_board, bytes((_RAW_PROMPT,)))


def main(sensor_name: str, scenario_name: str, seed: int, board: str, folder: str) -> None:
    """Serve a board until standard input closes."""
    sensor = load(SensorFile, sensor_name)
    scenario = Scenario(load(ScenarioFile, scenario_name))
    port = SerialPort()
    clock = RealClock()
    bus, usb = Bus(chip(sensor, scenario, seed), clock), UsbHost()
    machine = Machine(
        board_id(sensor),
        False,
        port.board_in,
        port.from_host,
        folder=Path(folder) if folder else None,
        board=board,
        blank=bool(folder),
        terminal=True,
    )
    try:
        print(json.dumps({"port": port.name, "started_s": clock.started_s}), flush=True)
        _serve(machine, bus, usb, port)
    finally:
        machine.close()


def _serve(machine: Machine, bus: Bus, usb: UsbHost, port: SerialPort) -> None:
    stdin = sys.stdin.fileno()
    while True:
        ready, _, _ = select.select([machine.requests, stdin, port.from_host], [], [])
        if stdin in ready and not os.read(stdin, 1):
            return
        if port.from_host in ready:
            port.pass_on()
        if machine.requests in ready:
            request = server.read_request(machine.requests)
            if request is None:
                machine.ended()
                machine.boot(run_entry=not port.raw_prompt)
                port.after_soft_reset()
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
