"""A substitute for python-evdev and for the kernel's input devices.

So that a test can observe another process, two environment variables have an effect. Each event is
written as a line to the file that ``STAND_IN_EVENTS`` names. The FIFO that ``STAND_IN_HANDLE``
names stays open like the handle of a device, which child processes inherit.
"""

import os
from types import SimpleNamespace
from typing import NamedTuple

from spots.outputs.usages import USAGES


class UInputError(Exception):
    pass


class AbsInfo(NamedTuple):
    value: int
    min: int
    max: int
    fuzz: int
    flat: int
    resolution: int


_KEYS = sorted({one.linux for one in USAGES.values()})
ecodes = SimpleNamespace(
    EV_SYN=0, EV_KEY=1, EV_ABS=3, EV_REP=0x14, ABS_X=0, ABS_Y=1, ABS_Z=2, BTN_GAMEPAD=0x130,
    BUS_VIRTUAL=6, ecodes={name: 1000 + i for i, name in enumerate(_KEYS)},
)  # fmt: skip
NAMES = {code: name for name, code in ecodes.ecodes.items()}


class UInput:
    """A virtual input device that stores the state that its events have reported.

    Attributes
    ----------
    made : list
        All devices, in the order of their creation.
    fails : Exception or None
        Error that is raised when the next device is created.
    """

    made: list = []
    fails = None

    def __init__(self, events, name, bustype):
        if UInput.fails is not None:
            raise UInput.fails
        self.capabilities, self.name = events, name
        self.known: dict = {}  # (type, code) to value, as of the last syn
        self.history: list = []
        self.closed = self.gone = False
        self._pending: list = []
        UInput.made.append(self)
        self._say("open")
        if "STAND_IN_HANDLE" in os.environ:
            self._handle = os.open(os.environ["STAND_IN_HANDLE"], os.O_WRONLY)
            os.set_inheritable(self._handle, True)
            os.write(self._handle, b"o")

    def write(self, kind, code, value):
        if self.closed or self.gone:
            raise OSError(19, "No such device")
        self._pending.append(((kind, code), value))

    def syn(self):
        if self.closed or self.gone:
            raise OSError(19, "No such device")
        for one, value in self._pending:
            if self.known.get(one, 0) != value:  # the kernel reports only changed values
                self.history.append((*one, value))
                self._say(*one, value)
        self.known.update(self._pending)
        self._pending.clear()

    def close(self):
        self.closed = True
        self._say("close")

    def held(self):
        return [one for one, value in self.known.items() if value]

    def _say(self, *words):
        path = os.environ.get("STAND_IN_EVENTS")
        if path:
            with open(path, "a") as file:
                file.write(" ".join(map(str, words)) + "\n")
