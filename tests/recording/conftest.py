"""Fixtures: a recording of the real firmware in simulated time, and the frames in it."""

from __future__ import annotations

from typing import NamedTuple

import pytest

from spots.link.board import Board
from spots.link.connect import prepare
from spots.link.frames import Frame
from spots.recording.recorder import Recorder
from spots_sim.board.lockstep import LockstepLink
from spots_sim.strip.files import ScenarioFile, load
from spots_sim.strip.scenario import Scenario


class Seen(NamedTuple):
    path: object
    frames: list[Frame]
    handed_s: list[float]
    board: Board


@pytest.fixture(scope="session")
def opened(sensor, calibration):
    """Return a function that opens a calibrated board with the scenario `demo`."""
    boards = []

    def open_board():
        link = LockstepLink(sensor, Scenario(load(ScenarioFile, "demo")))
        boards.append(Board(link))
        prepare(boards[-1], calibration)
        return boards[-1]

    yield open_board
    for board in boards:
        board.close()


@pytest.fixture(scope="session")
def seen(opened, tmp_path_factory):
    """A `Seen`: a recording of two seconds with all kinds of frames, and these frames."""
    path = tmp_path_factory.mktemp("seen") / "run.spots"
    board, frames, handed_s = opened(), [], []
    with Recorder(board, path):
        board.command("set keys=1")
        board.command("stream contact touch spectrum")
        for frame in board.frames(2.0):
            frames.append(frame)
            handed_s.append(board.now_s())
    return Seen(path, frames, handed_s, board)
