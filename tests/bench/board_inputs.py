"""Writes the inputs of ``board_costs.py``: a calibration, and counts of one and two fingers.

Run ``PYTHONPATH=tests .venv/bin/python -m bench.board_inputs``.
"""

from __future__ import annotations

from pathlib import Path

from spots.link.board import Board
from spots.link.frames import Spectrum
from spots_sim.board.lockstep import LockstepLink
from spots_sim.person.stage import calibrate
from spots_sim.strip.files import Finger, ScenarioFile, SensorFile, load
from spots_sim.strip.scenario import Scenario

_BEGIN_S = 0.5  # after the first dark frame
_ONE_S, _TWO_S, _END_S = 0.7, 1.2, 1.7
_ONE_MM, _TWO_MM = 20.0, 62.0
_FORCE_MN = 3000.0
_PRESS_S = 0.1


def write(folder: Path, sensor: SensorFile, calibration: list[str]) -> None:
    """Write ``calibration.inputs`` and ``counts.inputs`` into a folder.

    Each line of the counts is the number of fingers, and six counts with an exposure of 10 ms.
    """
    fingers = [_held(_ONE_MM, _ONE_S), _held(_TWO_MM, _TWO_S)]
    scenario = Scenario(ScenarioFile(seconds=2 * _END_S, touch=fingers))
    rows = []
    link = LockstepLink(sensor, scenario)
    with Board(link) as board:
        board.command("stream spectrum")
        for frame in board.frames(_END_S - link.now_s()):
            now_s = link.now_s()
            if isinstance(frame, Spectrum) and now_s > _BEGIN_S:
                rows.append(((now_s > _ONE_S) + (now_s > _TWO_S), *frame.counts))
    (folder / "calibration.inputs").write_text("\n".join(calibration), encoding="utf-8")
    lines = (" ".join(map(str, row)) for row in rows)
    (folder / "counts.inputs").write_text("\n".join(lines), encoding="utf-8")


def _held(place_mm: float, at_s: float) -> Finger:
    points = [(at_s, place_mm, 0.0), (at_s + _PRESS_S, place_mm, _FORCE_MN)]
    return Finger(points=[*points, (2 * _END_S, place_mm, _FORCE_MN)])


if __name__ == "__main__":
    default = load(SensorFile, "default")
    write(Path(), default, calibrate(default))
