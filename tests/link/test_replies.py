"""Boards with invalid replies: the host refuses them with one sentence."""

from __future__ import annotations

import contextlib
import json
import struct

import pytest
from support.frames import encoded

from spots.errors import SpotsError
from spots.link.board import Board
from spots_device import PROTOCOL

_TEXT = 3
GOOD = {
    "hello": {"protocol": PROTOCOL, "id": "a1", "exposure_us": 10000},
    "get": {"dark": [0] * 6, "full_scale": 1000, "fault": None},
    "set": {"exposure_us": 10000, "average": 1},
    "autoexpose": {"gain": 9, "led_mA": 20, "exposure_us": 10000},
    "dark": {"dark": [0] * 6},
    "sync": {"t_us": 2**32 - 1},
    "stream": {"stream": ["touch"]},
}
SOUND = {"id": [None, "x"], "fault": [None, "x"], "stream": [[], ["x"]]}
WRONG = [None, True, -1, 1e300, 0.5, "x", [], [[]], ["x"], {}, {"x": 1}, 2**70]


class Told:
    """A link to a substitute board that sends the replies of a test."""

    name = "told"

    def __init__(self, replies):
        self.replies, self._out, self._s = replies, b"", 0.0

    def now_s(self):
        self._s += 1e-4
        return self._s

    def read(self, timeout_s):
        out, self._out = self._out, b""
        self._s += 0.0 if out else timeout_s
        return out

    def write(self, data):
        for line in data.decode().splitlines():
            if line.split()[:1] and line.split()[0] in self.replies:
                name = line.split()[0]
                text = json.dumps({**self.replies[name], "re": name}).encode()
                time = struct.pack("<I", int(self._s * 1e6))
                self._out += encoded(bytes((_TEXT, 0, 0)) + time + text)

    def close(self):
        pass


def ask(name, reply):
    with Board(Told({**GOOD, name: reply})) as board:
        return board.command(name)


@pytest.mark.parametrize("name", GOOD)
def test_what_a_board_tells_is_passed_on(name):
    reply = {**GOOD[name], "new": 1}
    assert ask(name, reply).items() >= reply.items()


@pytest.mark.parametrize("value", WRONG, ids=json.dumps)
@pytest.mark.parametrize(
    ("name", "key"),
    [(name, key) for name, reply in GOOD.items() for key in reply if key != "protocol"],
)
def test_another_value_is_refused_unless_it_is_sound(name, key, value):
    sound = value in SOUND.get(key, [])
    with contextlib.nullcontext() if sound else pytest.raises(SpotsError):
        ask(name, {**GOOD[name], key: value})


FULL = "the board has a full file system: remove some of your files from it"


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("28", FULL),  # a MicroPython without the name of this error
        ("[Errno 28] No space left on device", FULL),  # CircuitPython
        ("OSError 28", FULL),
        ("the flash cannot be written: error 28", f"the flash cannot be written: {FULL}"),
        ("[Errno 30] Read-only filesystem", "the board has a read-only file system: reset"),
        ("a value of 28 is too large", "a value of 28 is too large"),
    ],
)
def test_a_refusal_says_an_error_of_the_operating_system_in_words(text, words):
    refusing = Told({**GOOD, "save": {"error": text, "errno": 28}})
    with Board(refusing) as board, pytest.raises(SpotsError) as raised:
        board.command("save")
    assert str(raised.value).startswith(f"the board refuses 'save': {words}")


@pytest.mark.parametrize("text", ["(5)", "([Errno 5] EIO)"])
def test_a_fault_of_the_bus_is_said_in_words(text):
    reply = {**GOOD["get"], "fault": f"the I2C bus failed {text}: check the wiring"}
    with Board(Told({**GOOD, "get": reply})) as board:
        fault = board.command("get")["fault"]
    assert fault == "the I2C bus failed (input/output error): check the wiring"
