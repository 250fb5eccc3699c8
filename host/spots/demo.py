"""The main job on the virtual board."""

from __future__ import annotations

import hashlib

from .board import Board
from .calibrate.stage import calibrate
from .connect import open_virtual, prepare
from .link import Link
from .score import Score
from .sim.faults import Faults, FaultyLink, of_scenario
from .sim.files import ScenarioFile, SensorFile, load
from .sim.lockstep import LockstepLink
from .sim.scenario import Scenario
from .watch import watch


class _Hashing:
    """A link that keeps the SHA-256 of all that was read from it."""

    def __init__(self, link: Link):
        self._link = link
        self.sha256 = hashlib.sha256()
        self.name, self.now_s, self.write = link.name, link.now_s, link.write
        self.close = link.close

    def read(self, timeout_s: float) -> bytes:
        data = self._link.read(timeout_s)
        self.sha256.update(data)
        return data


def demo(
    sensor: str, scenario: str, seed: int, seconds: float | None, fast: bool, quiet: bool
) -> dict:
    """Run the virtual board, show what it feels, and return the run in figures.

    Parameters
    ----------
    sensor, scenario : str
        Files, by path or name.
    seed : int
        Of the noise.
    seconds : float or None
        Length of the run; None for no end.
    fast : bool
        In simulated time: as fast as the machine can, the same bytes every time.
    quiet : bool
        Show nothing.
    """
    file = load(ScenarioFile, scenario)
    truth = Scenario(file)
    if fast:
        board, link = open_fast(sensor, truth, seed, of_scenario(file, seed))
        started_s = 0.0
    else:
        (board, started_s), link = open_virtual(sensor, scenario, seed), None
    score = Score(truth, started_s)
    with board:
        if file.faults:
            board.command("save")  # or a restart would cost the calibration
        watch(board, seconds, quiet, score)
        summary = score.summary(board.info, board.stats)
    if link is not None:
        summary["stream_sha256"] = link.sha256.hexdigest()
    return summary


def open_fast(
    sensor: str, truth: Scenario, seed: int, faults: Faults | None = None
) -> tuple[Board, _Hashing]:
    """Open a calibrated virtual board in simulated time, and the link that hashes its stream."""
    file = load(SensorFile, sensor)
    calibration = calibrate(file)
    bare = LockstepLink(file, truth, seed, faults=faults)
    link = _Hashing(FaultyLink(bare, faults) if faults else bare)
    board = Board(link)
    try:
        prepare(board, calibration)
    except BaseException:
        board.close()
        raise
    return board, link
