"""A tap that two devices see synchronises their clocks; its error is measured, and so is LSL's."""

from __future__ import annotations

import runpy
from pathlib import Path

import numpy as np
import pytest

import spots
from spots.link.board import Board
from spots.link.connect import prepare
from spots.recording.recorder import Recorder
from spots_sim.board.lockstep import LockstepLink
from spots_sim.strip.files import Finger, ScenarioFile
from spots_sim.strip.scenario import Scenario

pytestmark = pytest.mark.board

RECIPE = runpy.run_path(
    str(Path(__file__).parents[2] / "examples" / "synchronise" / "synchronise.py")
)
OFFSET_S, RATE = 3.217, 1 + 60e-6  # the other clock
TAPS_S = 2.0, 2.9, 3.73, 9.1, 10.02, 10.87
RISE_S = 0.03


def tapped(at_s):
    shape = [(0.0, 0), (RISE_S, 3000), (0.15, 3000), (0.18, 0)]
    return Finger(points=[(at_s + s, 42.0, force_mN) for s, force_mN in shape])


@pytest.fixture(scope="module")
def recorded(sensor, calibration, tmp_path_factory):
    path = tmp_path_factory.mktemp("taps") / "run.spots"
    scenario = Scenario(ScenarioFile(seconds=60.0, touch=[tapped(at_s) for at_s in TAPS_S]))
    with Board(LockstepLink(sensor, scenario, 1)) as board:
        prepare(board, calibration)
        with Recorder(board, path):
            board.stream("touch", "spectrum")
            for _ in board.frames(12.0 - board.now_s()):
                pass
    return path


def test_taps_give_the_other_clock(recorded, capsys, tmp_path, monkeypatch):
    # A force sensor with 500 samples a second and noise, whose clock is another one.
    noise = np.random.default_rng(1)
    true_s = np.arange(1.0, 12.0, 0.002)
    edges = np.array([0, RISE_S, 0.15, 0.18])
    force = sum(np.interp(true_s - at_s, edges, [0, 3, 3, 0]) for at_s in TAPS_S)
    force += noise.normal(0, 0.02, len(force))
    theirs_s = (true_s - OFFSET_S) / RATE + 5
    rows = "\n".join(f"{at_s:.6f},{one:.4f}" for at_s, one in zip(theirs_s, force))
    (tmp_path / "other.csv").write_text("time,force\n" + rows)
    monkeypatch.setattr("sys.argv", ["synchronise", str(recorded), str(tmp_path / "other.csv")])
    RECIPE["main"]()
    words = capsys.readouterr().out.split()
    offset_s, rate, said_ms = float(words[2]), float(words[4]), float(words[-2])
    begun_s = spots.Recording(recorded).header.host_s  # simulated time is the truth
    off_ms = 1000 * (begun_s + offset_s + rate * theirs_s - true_s)
    assert np.abs(off_ms).max() < 2.0  # a reading lasts 10 ms
    assert said_ms < 1.0


def test_too_few_taps_are_refused():
    with pytest.raises(SystemExit, match="2 and 3 taps were found: tap again"):
        RECIPE["fitted"](np.array([1.0, 2.0]), np.array([1.0, 2.0, 3.0]))
