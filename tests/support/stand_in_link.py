"""A link to a minimal substitute for a board."""

import json
import struct
from collections import Counter

from spots.errors import PortError, PortLostError
from spots_device import PROTOCOL
from support.fault_streams import encoded


class StandIn:
    """A link to a minimal substitute for a board, in simulated time; a reading every 10 ms."""

    name = "stand-in"

    def __init__(self, sequence):
        self.time_s = 100.0
        self.sequence = sequence
        self.streams = []
        self.asked = []
        self.deaf = set()  # commands whose replies are lost
        self.damaged = Counter()  # by command line: how many times it does not arrive
        self.booted_s = 0.0
        self._due = b""
        self.typing = False  # whether keys are sent all the time, as without a stream
        self.gone = 0  # number of attempts to open the port that fail
        self.tries_s = []
        self.closed = False
        self.board_id = None
        self.exposure_us = 10_000
        self.lines = []
        self.replies = {}  # additional items of the replies, by command

    def now_s(self):
        return self.time_s

    def sleep(self, duration_s):
        self.time_s += duration_s

    def reopen(self):
        self.tries_s.append(self.time_s)
        self.gone = max(0, self.gone - 1)
        if self.gone:
            raise PortError("there is no such port")
        self.closed = False

    def read(self, timeout_s):
        if self.gone:
            raise PortLostError("the board was disconnected")
        if not self._due:
            self.time_s += min(timeout_s, 0.01)
            if self.typing:
                self._due = self._frame(4, struct.pack("<BHBB", 7, 30, 0, self.sequence % 2))
            elif self.streams:
                self._due = self._frame(1, struct.pack("<Biiii", 9, 0, 0, 42_000, 0)[:15])
        data, self._due = self._due, b""
        return data

    def write(self, data):
        for line in data.decode().split("\n"):
            if self.damaged[line]:
                self.damaged[line] -= 1
            elif line:
                self._take(*line.split())

    def restart(self):
        self.streams, self.sequence, self.booted_s = [], 0, self.time_s

    def complain(self):
        """Send a log line with an error, as a board may do at its start."""
        self._due += self._frame(3, b'{"log": "error", "text": "stored settings are not used"}')

    def lose(self, frames):
        """Skip `frames` sequence numbers, as if so many frames were lost."""
        self.sequence = (self.sequence + frames) % 65_536

    def close(self):
        pass

    def close_port(self):
        self.closed = True

    def _take(self, name, *words):
        self.asked.append(name)
        self.lines.append(" ".join((name, *words)))
        reply = {"re": name}
        if name == "hello":
            reply |= {"protocol": PROTOCOL, "id": self.board_id}
            reply |= {"exposure_us": self.exposure_us}
        elif name == "sync":
            reply |= {"t_us": self._t_us(), "stream": self.streams}
        elif name == "stream" and words[-1] == "sensor=1":
            reply |= {"stream": sorted(words[:-1]), "sensor": 1}
        elif name == "stream":
            self.streams = [] if words == ("off",) else sorted(words)
            reply["stream"] = sorted(words)
        reply |= self.replies.get(name, {})
        frame = self._frame(3, json.dumps(reply).encode())
        if name not in self.deaf:
            self._due += frame

    def _frame(self, kind, body):
        sequence, self.sequence = self.sequence, (self.sequence + 1) % 65_536
        return encoded(struct.pack("<BHI", kind, sequence, self._t_us()) + body)

    def _t_us(self):
        return int(1e6 * (self.time_s - self.booted_s)) % (1 << 32)
