"""Stand-ins for what plays keyboards and gamepads, so that every machine runs every test."""

import os
import sys
from pathlib import Path

import pytest

STAND_INS = Path(__file__).parent / "stand_ins"


def _without(monkeypatch, *names):
    for name in [*sys.modules]:
        if name.split(".")[0] in names:
            monkeypatch.delitem(sys.modules, name)


@pytest.fixture
def evdev(monkeypatch):
    """The stand-in for evdev, which is what ``import evdev`` finds."""
    _without(monkeypatch, "evdev")
    monkeypatch.syspath_prepend(str(STAND_INS))
    import evdev

    assert Path(evdev.__file__).parent == STAND_INS
    yield evdev
    _without(monkeypatch, "evdev")


@pytest.fixture
def pynput(monkeypatch):
    """The stand-in for pynput's keyboard."""
    _without(monkeypatch, "pynput")
    monkeypatch.syspath_prepend(str(STAND_INS))
    from pynput import keyboard

    assert Path(keyboard.__file__).parent.parent == STAND_INS
    yield keyboard
    _without(monkeypatch, "pynput")


@pytest.fixture
def environment():
    """The environment of a process that finds the stand-ins."""
    path = os.pathsep.join([str(STAND_INS), *filter(None, sys.path)])
    return {**os.environ, "PYTHONPATH": path}
