"""A virtual board in real time: a process of its own with a PTY that pyserial opens.

Run as ``python -m spots.sim.realtime SENSOR SCENARIO SEED``. It prints one JSON object, the port
and the host's monotonic time of power-on, and lives until its standard input closes, so that it
never outlives whoever started it.
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

from ..errors import SpotsError
from . import server
from .bus import Bus
from .files import ScenarioFile, SensorFile, load
from .identity import board_id
from .scenario import Scenario
from .vm import Machine
from .world import chip


class RealClock:
    """The host's monotonic clock; transfers take the time that they take."""

    def __init__(self):
        self.started_s = time.monotonic()

    def now_us(self) -> float:
        return (time.monotonic() - self.started_s) * 1e6

    def spend_us(self, duration_us: float) -> None:
        pass


def main(sensor_name: str, scenario_name: str, seed: int) -> None:
    """Serve a board until standard input closes."""
    sensor = load(SensorFile, sensor_name)
    scenario = Scenario(load(ScenarioFile, scenario_name))
    board_end, port_end = pty.openpty()
    # Raw before anyone opens it: a terminal would echo the board's frames back as commands. The
    # port's end stays open here, so that the board sees no hang-up between two readers.
    tty.setraw(port_end)
    os.set_blocking(board_end, False)
    clock = RealClock()
    bus = Bus(chip(sensor, scenario, seed), clock)
    machine = Machine(board_id(sensor), False, board_end, board_end)
    try:
        print(json.dumps({"port": os.ttyname(port_end), "started_s": clock.started_s}), flush=True)
        _serve(machine, bus)
    finally:
        machine.close()


def _serve(machine: Machine, bus: Bus) -> None:
    stdin = sys.stdin.fileno()
    while True:
        ready, _, _ = select.select([machine.requests, stdin], [], [])
        if stdin in ready and not os.read(stdin, 1):
            return
        if machine.requests in ready:
            request = server.read_request(machine.requests)
            if request is None:
                machine.ended()
            else:
                server.answer(request, bus, machine.answers)


if __name__ == "__main__":
    try:
        with contextlib.suppress(KeyboardInterrupt):
            main(sys.argv[1], sys.argv[2], int(sys.argv[3]))
    except SpotsError as error:
        print(json.dumps({"error": str(error)}), flush=True)
        sys.exit(2)
