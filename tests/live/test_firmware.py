"""The firmware in MicroPython for WebAssembly against MicroPython for Unix."""

from __future__ import annotations

import json
import os
import subprocess
from pathlib import Path

import pytest

from spots.link.board import Board
from spots.link.connect import prepare
from spots.link.decoder import Decoder
from spots.link.frames import Text
from spots_device.reading.frame import TOUCH
from spots_sim.board.lockstep import LockstepLink
from spots_sim.strip.files import ScenarioFile, SensorFile, load
from spots_sim.strip.scenario import Scenario

pytestmark = pytest.mark.board
# More than a run of all tests can pay for: SPOTS_LIVE_SECONDS=100 is 10,000 samples.
SECONDS = float(os.environ.get("SPOTS_LIVE_SECONDS", "10"))


class Recorded:
    """A bus and its clock whose requests and answers are stored in `entries`."""

    def __init__(self, bus):
        self._bus, self.clock = bus, self
        self._clock = bus.clock
        self.entries: list[dict] = []
        self.typed = self.first = b""  # what the host sends; before the first request

    def __getattr__(self, name):
        return getattr(self._bus, name)

    def now_us(self):
        return self._clock.now_us()

    def spend_us(self, duration_us):
        self._clock.spend_us(duration_us)

    def pause_us(self, duration_us):
        self._clock.pause_us(duration_us)
        self._add(None, "sleep", int(duration_us))

    def write(self, address, data):
        return self._answered(self._bus.write, "write", address, bytes(data))

    def write_read(self, address, data, size):
        return self._answered(self._bus.write_read, "read", address, bytes(data), size)

    def _answered(self, transfer, kind, address, data, *size):
        asked = kind, address, data.hex(), *size
        try:
            answer = transfer(address, data, *size)
        except OSError as error:
            self._add(error.errno, *asked)
            raise
        self._add(answer and bytes(answer).hex(), *asked)
        return answer

    def _add(self, answer, *asked):
        typed, self.typed = self.typed, b""
        time_us = int(self._clock.now_us())
        self.entries.append(
            {"asked": asked, "answer": answer, "time_us": time_us, "typed": typed.hex()}
        )


class Link(LockstepLink):
    """A virtual board whose bus, input and output are recorded."""

    def __init__(self, *arguments):
        super().__init__(*arguments, board="virtual")
        self.bus = self.recorded = Recorded(self.bus)
        self.sent = b""

    def write(self, data):
        self.recorded.typed += data
        super().write(data)
        if not self.recorded.entries:  # the board waits for an answer that is not recorded
            self.recorded.first += self.recorded.typed
            self.recorded.typed = b""

    def read(self, timeout_s):
        data = super().read(timeout_s)
        self.sent += data
        return data


def frames(data):
    """Return the encoded frames of a stream; a port may pad them with zeros."""
    return list(filter(None, data.split(b"\0")[:-1]))


def hello(frame):
    """Return the content of a reply to ``hello``, without the runtime; None for other frames."""
    for found in Decoder().feed(frame + b"\0"):
        if isinstance(found, Text) and found.content.get("re") == "hello":
            return {name: value for name, value in found.content.items() if name != "runtime"}
    return None


def test_the_board_of_the_tab_sends_the_bytes_of_the_unix_port(
    node, live, calibration, monkeypatch
):
    # Fails if the arithmetic, the frames or the order of requests differ on 32-bit WebAssembly.
    monkeypatch.delenv("SPOTS_VIRTUAL_RUNTIME", raising=False)
    sensor = load(SensorFile, "default")
    link = Link(sensor, Scenario(load(ScenarioFile, "demo")))
    with Board(link) as board:
        identity = board.info["id"]
        prepare(board, calibration)
        board.command("stream touch spectrum contact")
        for _ in board.frames(SECONDS):
            pass
    given = {"page": str(live), "id": identity}
    given |= {"typed": link.recorded.first.hex(), "entries": link.recorded.entries}
    script = Path(__file__).with_name("firmware.mjs")
    run = subprocess.run(
        [node, script], input=json.dumps(given), capture_output=True, text=True, check=False
    )
    assert run.returncode == 0, run.stderr[-2000:]
    ours, theirs = map(frames, (link.sent, bytes.fromhex(run.stdout)))
    theirs = theirs[: len(ours)]  # the last ones wait in the port
    assert sum(frame[1] == TOUCH for frame in theirs) > 99 * SECONDS
    different = [(one, other) for one, other in zip(ours, theirs) if one != other]
    assert all(hello(one) and hello(one) == hello(other) for one, other in different)
