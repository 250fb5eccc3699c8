"""A virtual board on CPython in real time: a process of its own with a PTY or a loopback socket.

Run as ``python -m spots_sim.cpython_realtime SENSOR SCENARIO SEED``. It prints one JSON object as
`realtime` does and lives as long: until its standard input closes or its parent ends.
"""

from __future__ import annotations

import contextlib
import os
import socket
import sys
import threading
import time

from spots.errors import SpotsError

from .bus import I2CBus, RealClock
from .cpython_board import BoardPort, CPythonBoard
from .faults import BoardFaults, Faults, FaultyBus, of_scenario
from .files import ScenarioFile, SensorFile, load
from .identity import board_id
from .runtimes import is_socket
from .scenario import Scenario
from .starting import report
from .usb import UsbHost
from .world import chip

_CHUNK = 4096
_END_S = 5.0  # for the board to end cleanly once the parent has


class PtyPort:
    """A pseudo-terminal. The host's end stays open here, so that a reader may come and go."""

    def __init__(self):
        import pty
        import tty

        self._end, host_end = pty.openpty()
        tty.setraw(host_end)  # or it would echo frames back as commands
        os.set_blocking(self._end, False)
        self.name = os.ttyname(host_end)

    def receive(self) -> bytes:
        try:
            return os.read(self._end, _CHUNK)
        except BlockingIOError:
            return b""

    def send(self, data: bytes) -> int:
        try:
            return os.write(self._end, data)
        except BlockingIOError:
            return 0


class SocketPort:
    """A TCP socket on loopback, for one program at a time: further ones are disconnected."""

    def __init__(self):
        self._server = socket.create_server(("127.0.0.1", 0))
        self._server.setblocking(False)
        self._peer: socket.socket | None = None
        self.name = f"socket://127.0.0.1:{self._server.getsockname()[1]}"

    def receive(self) -> bytes:
        self._accept()
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
            return len(data)  # as a port that nobody has opened
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
    """Damages the bytes of another port, as a scenario says."""

    def __init__(self, port: BoardPort, faults: Faults, clock: RealClock):
        self._port, self._faults, self._clock = port, faults, clock

    def receive(self) -> bytes:
        return self._faults.to_board(self._port.receive(), self._clock.now_us())

    def send(self, data: bytes) -> int:
        self._port.send(self._faults.to_host(data, self._clock.now_us()))
        return len(data)


def main(sensor_name: str, scenario_name: str, seed: int) -> None:
    """Serve a board until standard input closes or the parent ends.

    Parameters
    ----------
    sensor_name, scenario_name : str
        Sensor and scenario file: a path or a name.
    seed : int
        Random seed of noise and faults.

    Raises
    ------
    SpotsError
        If a file is missing or invalid.
    """
    parent, ended = os.getppid(), _end_of_input()
    sensor = load(SensorFile, sensor_name)
    file = load(ScenarioFile, scenario_name)
    clock = RealClock()
    bus = I2CBus(chip(sensor, Scenario(file), seed), clock)
    outer = port = SocketPort() if is_socket() else PtyPort()
    faults = of_scenario(file, seed)
    if faults:
        bus, port = FaultyBus(bus, faults), NoisyPort(port, faults, clock)
    board_faults = BoardFaults(faults) if faults else None
    with contextlib.closing(
        CPythonBoard(board_id(sensor), bus, UsbHost(), port, board_faults)
    ) as board:
        report({"port": outer.name, "console": outer.name, "started_s": clock.started_s})
        # Another process may have inherited the pipe and keep it open after the parent ends.
        while not ended.is_set() and os.getppid() == parent:
            board.step()


def _end_of_input() -> threading.Event:
    """Return what is set at the end of standard input.

    A thread of its own notices it, for Windows cannot wait for a pipe in any other way. It ends the
    process if the rest of it does not in time, also if it fails itself: so it is not guarded.
    """
    ended, stdin = threading.Event(), sys.stdin.fileno()

    def watch():
        try:
            os.read(stdin, 1)
        finally:
            ended.set()
            time.sleep(_END_S)
            os._exit(1)

    threading.Thread(target=watch, daemon=True).start()
    return ended


if __name__ == "__main__":
    try:
        with contextlib.suppress(KeyboardInterrupt):
            main(sys.argv[1], sys.argv[2], int(sys.argv[3]))
    except SpotsError as error:
        report({"error": str(error)})
        sys.exit(2)
