"""A virtual board in simulated time: real firmware in a real MicroPython."""

from __future__ import annotations

import pytest

from spots.link.board import Board
from spots.link.connect import upload
from spots.link.frames import Key, Spectrum, Touch
from spots_sim.lockstep import LockstepLink
from spots_sim.scenario import Held, Press


class Rig:
    """A virtual board, its link in simulated time, and a stage that presses the strip."""

    def __init__(self, sensor, calibration=None, folder=None, scenario=None, seed=0, **options):
        self.held = Held()
        self.link = LockstepLink(sensor, scenario or self.held, seed, folder, **options)
        self.board = Board(self.link)
        if calibration:
            upload(self.board, calibration)

    def press(self, position_mm, force_mN):
        self.held.press = Press(position_mm, force_mN, 4.0)

    def release(self):
        self.held.press = None

    def readings(self, count, kind=Touch):
        """Return the next `count` frames of a kind whose integration begins after this call."""
        self.board.command("stream " + ("touch" if kind is Touch else "spectrum"))
        self.settle()
        frames = (frame for frame in self.board.frames() if isinstance(frame, kind))
        return [next(frames) for _ in range(count)]

    def settle(self, seconds=0.15):
        """Let time pass; unlike `Board.frames`, this starts no stream."""
        for _ in self.board._start(seconds, Touch, Spectrum, Key, wanted=False):
            pass

    def spectra(self, count):
        return self.readings(count, Spectrum)

    def close(self):
        self.board.close()


@pytest.fixture
def rig(sensor, request):
    """Return a function that makes calibrated or uncalibrated rigs.

    They are closed after the test.
    """
    made = []

    def make(**options):
        made.append(Rig(options.pop("sensor", sensor), **options))
        return made[-1]

    yield make
    for one in made:
        one.close()
