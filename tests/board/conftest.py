"""Fixtures: a virtual board in simulated time, with the firmware in a real MicroPython."""

from __future__ import annotations

import tempfile
from pathlib import Path

import pytest
from support.boards import store

from spots.deploy import flash
from spots.link.board import Board
from spots.link.connect import upload
from spots.link.frames import Key, Spectrum, Touch
from spots_device.board.settings import checksum
from spots_sim.board.kept_folder import FOLDER
from spots_sim.board.lockstep import LockstepLink
from spots_sim.strip.scenario import Held, Press


class Rig:
    """A virtual board, its link in simulated time, and a simulated finger.

    Without a folder for its files, the board starts with a saved calibration, which is faster than
    an upload.
    """

    def __init__(self, sensor, calibration=None, folder=None, scenario=None, seed=0, **options):
        self.held = Held()
        self._own = None
        if calibration and not folder:
            self._own = tempfile.TemporaryDirectory(prefix="spots-")
            folder = Path(self._own.name)
            store(folder, calibration=calibration)
        self.link = LockstepLink(sensor, scenario or self.held, seed, folder, **options)
        self.board = Board(self.link)
        if self._own:
            self._await(checksum(calibration))
            self.board.calibration = list(calibration)
        elif calibration:
            upload(self.board, calibration)

    def _await(self, calibration):
        # The board uses its saved calibration only after its sensor has started.
        for _ in range(50):
            self.board.info.update(self.board.command("hello"))
            if self.board.info["calibration"] == calibration:
                return
            self.settle(0.05)
        raise AssertionError("the board does not use its calibration")

    @property
    def replies(self):
        """What the board replied, also to lines that the test itself wrote."""
        return [reply.content for reply in self.board.channel.replies]

    def press(self, position_mm, force_mN):
        self.held.press = Press(position_mm, force_mN, 4.0)

    def release(self):
        self.held.press = None

    def readings(self, count, kind=Touch):
        """Return `count` frames of the class `kind` whose integration begins after this call."""
        self.board.command("stream " + ("touch" if kind is Touch else "spectrum"))
        self.settle()
        frames = (frame for frame in self.board.frames() if isinstance(frame, kind))
        return [next(frames) for _ in range(count)]

    def settle(self, seconds=0.15):
        """Let simulated time pass; unlike `Board.frames`, this starts no stream of frames."""
        for _ in self.board._streams.start(seconds, Touch, Spectrum, Key, wanted=False):
            pass

    def spectra(self, count):
        return self.readings(count, Spectrum)

    def close(self):
        self.board.close()
        if self._own:
            self._own.cleanup()


@pytest.fixture
def in_micropython(monkeypatch):
    """Run the firmware in MicroPython, also in a module of `conftest.IN_CPYTHON`."""
    monkeypatch.delenv("SPOTS_VIRTUAL_RUNTIME", raising=False)


@pytest.fixture
def in_cpython(monkeypatch):
    """Run the firmware in CPython, which needs a third less processor time than MicroPython."""
    monkeypatch.setenv("SPOTS_VIRTUAL_RUNTIME", "cpython")


@pytest.fixture
def shared_builds(monkeypatch, built):
    """Let `flash` copy the builds that all tests share; test_upgrade.py flashes fresh ones."""
    monkeypatch.setattr(flash, "build", lambda board, root, strips: built(board, strips))


@pytest.fixture
def own_firmware(monkeypatch):
    """Give each board its own copy of the firmware, as Python sources."""
    monkeypatch.delenv(FOLDER)


@pytest.fixture
def rig(sensor, request):
    """Return a function that creates a `Rig`, with or without a calibration.

    Each rig is closed after the test.
    """
    made = []

    def make(**options):
        made.append(Rig(options.pop("sensor", sensor), **options))
        return made[-1]

    yield make
    for one in made:
        one.close()
