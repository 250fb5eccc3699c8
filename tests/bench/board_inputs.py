"""Writes the inputs of ``board_costs.py``: a calibration, and readings of one and two fingers.

Run ``PYTHONPATH=tests .venv/bin/python -m bench.board_inputs``.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np

from spots.link.board import Board
from spots.link.connect import prepare
from spots_sim.board.lockstep import LockstepLink
from spots_sim.person.stage import calibrate, set_as_calibrated
from spots_sim.strip.files import (
    Finger,
    ScenarioFile,
    SensorFile,
    load,
)
from spots_sim.strip.scenario import Scenario

_SECONDS = 6.0
_FORCE_MN = 3000.0
_PRESS_S = 0.1


def main() -> None:
    """Write ``calibration.inputs`` and ``readings.inputs`` into the current folder."""
    sensor = load(SensorFile, "default")
    lines = calibrate(sensor)
    first = _presses(20.0, (0.2, 1.8), (2.2, 3.8), (4.2, 5.8))
    # The second finger arrives while the first one rests, and while its force still grows.
    second = _presses(62.0, (0.7, 1.5), (2.28, 3.5), (4.25, 5.5))
    readings = _readings(sensor, lines, [first]) + _readings(sensor, lines, [first, second])
    Path("calibration.inputs").write_text("\n".join(lines), encoding="utf-8")
    Path("readings.inputs").write_bytes(np.array(readings, dtype="<i4").tobytes())


def _presses(place_mm: float, *times_s: tuple[float, float]) -> Finger:
    points = []
    for down_s, up_s in times_s:
        points += [(down_s, place_mm, 0.0), (down_s + _PRESS_S, place_mm, _FORCE_MN)]
        points += [(up_s, place_mm, 0.8 * _FORCE_MN), (up_s + _PRESS_S, place_mm, 0.0)]
    return Finger(points=points)


def _readings(sensor: SensorFile, lines, fingers: list[Finger]) -> list[list[int]]:
    scenario = Scenario(ScenarioFile(seconds=_SECONDS, touch=fingers))
    with Board(LockstepLink(sensor, scenario)) as board:
        set_as_calibrated(board, sensor)
        prepare(board, lines)
        return [
            [touch.flags, *touch.integers, touch.brightness_q20]
            for touch in board.touches(_SECONDS)
        ]


if __name__ == "__main__":
    main()
