"""A virtual board on CPython in real time: a process with a pseudo-terminal or a loopback socket.

Run it as ``python -m spots_sim.board.cpython_realtime SENSOR SCENARIO SEED STRIPS``. It prints one
JSON object with its port, see `realtime`. It ends when its standard input closes or its parent
ends.
"""

from __future__ import annotations

import contextlib
import os
import socket
import sys
import threading

from spots.errors import SpotsError

from ..chip.bus import I2CBus, RealClock
from ..strip.files import ScenarioFile, SensorFile, load
from ..strip.scenario import Scenario
from ..strip.world import chip
from .cpython_board import BoardPort, CPythonBoard
from .faults import BoardFaults, Faults, FaultyBus, of_scenario
from .identity import board_id
from .runtimes import is_socket
from .starting import PseudoTerminal, report, when_parent_ends
from .usb import UsbHost

_CHUNK = 4096


class PtyPort(PseudoTerminal):
    """A serial port (`cpython_board.BoardPort`) on a pseudo-terminal."""

    def receive(self) -> bytes:
        try:
            return os.read(self.board_end, _CHUNK)
        except BlockingIOError:
            return b""

    def send(self, data: bytes) -> int:
        try:
            return os.write(self.board_end, data)
        except BlockingIOError:
            return 0


class SocketPort:
    """A serial port (`cpython_board.BoardPort`) on a TCP socket of the loopback interface.

    It accepts one client at a time and disconnects all others.
    """

    def __init__(self):
        self._server = socket.create_server(("127.0.0.1", 0))
        self._server.setblocking(False)
        self._peer: socket.socket | None = None
        self.name = f"socket://127.0.0.1:{self._server.getsockname()[1]}"

    def receive(self) -> bytes:
        data = self._from_peer()
        # A client that connects right after another one has closed must not be refused, so the end
        # of the other one is read first.
        if not data:
            self._accept()
        return data

    def _from_peer(self) -> bytes:
        if self._peer is None:
            return b""
        try:
            data = self._peer.recv(_CHUNK)
        except BlockingIOError:
            return b""
        except OSError:
            data = b""
        if not data:
            self._disconnect()
        return data

    def send(self, data: bytes) -> int:
        if self._peer is None:
            return len(data)  # discards data like a port that no program has opened
        try:
            return self._peer.send(data)
        except BlockingIOError:
            return 0
        except OSError:
            self._disconnect()
            return len(data)

    def _accept(self) -> None:
        with contextlib.suppress(BlockingIOError):
            peer, _ = self._server.accept()
            if self._peer is not None:
                peer.close()
                return
            peer.setblocking(False)
            peer.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
            self._peer = peer

    def _disconnect(self) -> None:
        self._peer.close()
        self._peer = None


class NoisyPort:
    """Damages the bytes of another port as the scenario's faults describe."""

    def __init__(self, port: BoardPort, faults: Faults, clock: RealClock):
        self._port, self._faults, self._clock = port, faults, clock

    def receive(self) -> bytes:
        return self._faults.to_board(self._port.receive(), self._clock.now_us())

    def send(self, data: bytes) -> int:
        self._port.send(self._faults.to_host(data, self._clock.now_us()))
        return len(data)


def main(sensor_name: str, scenario_name: str, seed: int, strips: int) -> None:
    """Run a virtual board until standard input closes or the parent ends; see `realtime.main`."""
    ended = threading.Event()
    when_parent_ends(ended.set)
    sensor = load(SensorFile, sensor_name)
    file = load(ScenarioFile, scenario_name)
    clock = RealClock()
    bus = I2CBus(chip(sensor, Scenario(file), seed), clock)
    second = I2CBus(chip(sensor, Scenario(file), seed + 1), clock) if strips > 1 else None
    outer = port = SocketPort() if is_socket() else PtyPort()
    faults = of_scenario(file, seed)
    if faults:
        bus, port = FaultyBus(bus, faults), NoisyPort(port, faults, clock)
    board_faults = BoardFaults(faults) if faults else None
    with contextlib.closing(
        CPythonBoard(board_id(sensor, seed), bus, UsbHost(), port, board_faults, second=second)
    ) as board:
        report({"port": outer.name, "console": outer.name, "started_s": clock.started_s})
        while not ended.is_set():
            board.step()


if __name__ == "__main__":
    try:
        with contextlib.suppress(KeyboardInterrupt):
            main(sys.argv[1], sys.argv[2], *map(int, sys.argv[3:5]))
    except SpotsError as error:
        report({"error": str(error)})
        sys.exit(2)
