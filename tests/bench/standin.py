"""A simple substitute for a board, for benchmarks: sends frames and answers commands.

It needs much less processor time than a virtual board.
"""

from __future__ import annotations

import json
import time

from support.touch_framer import TouchFramer

from spots_device import PROTOCOL
from spots_device.reading.decode import HEAD_SIZE, TIME_HIGH, TIME_LOW

CLOSING_UM = -1
_IDLE_S = 0.05


class StandIn:
    """A link to a substitute board that sends always the same reading, with the present time.

    A reading is a TOUCH and a SPECTRUM frame. Their `t_us` is the computer's monotonic clock, so
    each process on this computer can compute the age of a frame.

    Parameters
    ----------
    board_id : str
        Id of the board.
    rate_Hz : float
        Readings per second.

    Attributes
    ----------
    fast : bool
        Whether readings have the rate `rate_Hz`; otherwise there are 20 a second.
    closing : bool
        Whether the position of the next readings is `CLOSING_UM`, which marks the end of the test.
    said : list of str
        The command lines that the board has received.
    closed_at : int or None
        Sequence number of the first frame with this position; None before it.
    """

    flags, contrast, brightness, position_um, force_mN = 1, 3 << 18, 12 << 20, 42_500, 3_000

    def __init__(self, board_id: str, rate_Hz: float):
        self.name = f"stand-in {board_id}"
        self.fast = self.closing = False
        self.said: list[str] = []
        self.closed_at: int | None = None
        self._id, self._period_s = board_id, 1 / rate_Hz
        self._port = _Port()
        self._framer = TouchFramer(self._port, self._port)
        self._streams: list[str] = []
        self._due_s = 0.0

    def now_s(self) -> float:
        return time.monotonic()

    def sleep(self, duration_s: float) -> None:
        time.sleep(duration_s)

    def read(self, timeout_s: float) -> bytes:
        if not self._port.out:
            due_s = self._due_s if self._streams else float("inf")
            time.sleep(max(0.0, min(timeout_s, due_s - self.now_s())))
            if self.now_s() >= due_s:
                self._due_s = (due_s or self.now_s()) + (self._period_s if self.fast else _IDLE_S)
                self._send_reading()
        data, self._port.out = self._port.out, b""
        return data

    def write(self, data: bytes) -> None:
        for line in data.decode().split("\n"):
            if line:
                self.said.append(line)
                self._port.set_time()
                self._framer.text(json.dumps(self._reply(*line.split())).encode())

    def reopen(self) -> None:
        """Do nothing, because this substitute is never disconnected."""

    def close(self) -> None:
        self._streams = []

    def _reply(self, name: str, *words: str) -> dict:
        if name == "stream":
            self._streams = [word for word in words if word != "off"]
            return {"re": name, "stream": list(words)}
        hello = {"protocol": PROTOCOL, "board": "stand-in", "runtime": "none", "id": self._id}
        replies = {
            "hello": hello
            | {"channels": ["F3", "F4", "F5", "F6", "F7", "F8"], "exposure_us": 10_000},
            "get": {"gain": 9},
            "sync": {"t_us": self._port.t_us, "stream": self._streams},
        }
        return {"re": name, **replies.get(name, {"error": "no such command"})}

    def _send_reading(self) -> None:
        self._port.set_time()
        if self.closing and self.closed_at is None:
            self.closed_at, self.position_um = self._port.count, CLOSING_UM
        fields = self.flags, self.contrast, self.brightness, self.position_um, self.force_mN
        self._framer.touch(0, fields)
        self._framer.spectrum(0, self.flags, 9, (1000, 2000, 3000, 4000, 5000, 6000), [64] * 8)


class _Port:
    """The serial port and the board time of a `Framer`."""

    def __init__(self):
        self.out = b""
        self.count = 0
        self.head = [0] * HEAD_SIZE
        self.set_time()

    def set_time(self) -> None:
        self.t_us = time.monotonic_ns() // 1000 & 0xFFFFFFFF
        self.head[TIME_LOW], self.head[TIME_HIGH] = self.t_us & 0xFFFF, self.t_us >> 16

    def write(self, buffer: bytes, size: int) -> bool:
        self.out += buffer[:size]
        self.count += 1
        return True
