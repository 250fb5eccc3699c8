"""Measures errors of typing, and of a joint's angle, while the LED of the strip warms up.

Run it with ``PYTHONPATH=tools python -m evidence.from_cold 20``; the argument is a number of
simulated minutes. The strip was calibrated with a warm LED. Since its calibration the strip has
changed as the table ``[change]`` of its sensor file describes.
"""

from __future__ import annotations

import argparse
import json
import math

import numpy as np

from spots.calibrate.calibration_file import CalibrationFile, Marks, now
from spots.calibrate.session.rezero import rezero
from spots.calibrate.session.session_file import settings
from spots.calibrate.session.spectra import DARK_S
from spots.cli.arguments import number
from spots.keyboard.layout import load as load_layout
from spots.link.board import Board
from spots.link.connect import prepare, upload
from spots.link.frames import Touch
from spots_sim.board.lockstep import LockstepLink
from spots_sim.demo.demo_applications import type_on_board
from spots_sim.measure.rezeroed import Hand, age, silent_bench
from spots_sim.measure.rig import Rig
from spots_sim.person.stage import Stage
from spots_sim.person.stage_presser import StagePresser
from spots_sim.person.typist import Typist
from spots_sim.strip.files import (
    JOINT_TRAVEL,
    ScenarioFile,
    SensorFile,
    load,
)
from spots_sim.strip.scenario import Scenario

WARM_MIN = 5  # minutes: five time constants of the warming LED
_SHARES = np.linspace(0, 1, 31)  # angles, as shares of the joint's travel
_READINGS = 6
_TEST_EVERY = 3  # every third of these angles is tested
_SETTLE_S = 0.1
_MARK_SAMPLES = 200
_MINUTES = number("a number of minutes", 1, 10_000)


def typing(sensor: SensorFile, minutes: float, seed: int, rezeroed: bool) -> dict:
    """Type random digits while the LED warms up, and count the errors; see `type_on_board`.

    With `rezeroed`, the calibration was corrected with a warm LED before the run.
    """
    rng = np.random.default_rng(seed)
    with Rig(sensor, seed, 10_000, 1) as rig:
        age(rig, sensor.change, Hand(3 if rezeroed else 0), seed)
        lines = rig.shifted_lines
    somebody = Typist(load_layout("digits"), sensor.length_mm, rng, start_s=3.0)
    while somebody.seconds < 60 * minutes:
        somebody.type(str(rng.integers(10)))
    truth = Scenario(ScenarioFile(seconds=somebody.seconds + 1, touch=somebody.touches))
    with Board(LockstepLink(sensor, truth, seed)) as board:
        prepare(board, lines)
        return type_on_board(board, truth, 0.0, somebody.seconds - board.now_s(), True, "digits")


def joint(
    sensor: SensorFile, minutes: float, seed: int, average: int, warm_min: int = WARM_MIN
) -> list[dict]:
    """Measure errors of a joint's angle while the LED warms up; correct the drift one time.

    The drift is corrected `warm_min` after switching on. A reading has `average` samples of 10 ms.
    Each dict is for a minute, measured in its middle: ``rezeroed`` is whether the drift was
    corrected before, ``accuracy_deg`` the mean absolute error of single readings.
    """
    with Rig(sensor, seed, 10_000, average) as rig:
        conditions, lines = rig.conditions, rig.lines
        angles, positions = _turn(rig.stage, _SHARES)
        slope, zero = np.polyfit(positions.ravel(), np.repeat(angles, _READINGS), 1)
        rig.set_average(1)
        rig.stage.reader.set_up(dark_s=DARK_S)
        marks = _marks(rig.stage, _SHARES[[0, len(_SHARES) // 2, -1]])
    made = CalibrationFile(date=now(), **conditions._asdict(), lines=lines, joint_marks=marks)
    found = []
    with Stage(sensor, seed + 1, settings(conditions), warm_s=0.0) as stage:
        stage.held.changed = sensor.change
        board = stage.board
        for minute in range(1, round(minutes) + 1):
            rezeroed = minute > warm_min
            if minute == warm_min + 1:
                bench = silent_bench(stage, StagePresser(stage))
                upload(board, rezero(bench, made, joint=True).lines)
            elif minute == 1:
                upload(board, lines)
            board.command(f"set average={average}")
            board.command("stream touch")
            for _ in board.frames(60 * minute - 30 - board.now_s()):
                pass
            angles, positions = _turn(stage, _SHARES[1::_TEST_EVERY])
            error = slope * positions + zero - angles[:, None]
            accuracy = round(float(np.abs(error).mean()), 4)
            found.append({"minute": minute, "rezeroed": rezeroed, "accuracy_deg": accuracy})
            board.command("set average=1")
    return found


def _turn(stage: Stage, shares) -> tuple[np.ndarray, np.ndarray]:
    """Turn the joint up, then down, through ascending shares of its travel; read the positions.

    Returns angles in degrees, shape (n,), and positions in um, shape (n, `_READINGS`).
    """
    angles, rows = [], []
    for direction, sweep in ((1, shares), (-1, shares[::-1])):
        for share in sweep:
            angle_deg = share * stage.sensor.joint_travel_deg
            stage.turn(angle_deg, direction)
            begun_s = stage.board.now_s() + _SETTLE_S
            row = []
            for frame in stage.board.frames():
                if not isinstance(frame, Touch) or frame.time_s <= begun_s:
                    continue
                if not math.isnan(frame.position_um):
                    row.append(frame.position_um)
                    if len(row) == _READINGS:
                        break
            angles.append(angle_deg)
            rows.append(row)
    return np.array(angles), np.array(rows, dtype=float)


def _marks(stage: Stage, shares) -> Marks:
    angles, counts = shares * stage.sensor.joint_travel_deg, []
    for angle_deg in angles:
        stage.turn(angle_deg)
        counts.append(stage.reader.read(_MARK_SAMPLES).counts)
    start, end = JOINT_TRAVEL
    return Marks(
        place_um=tuple(((start + (end - start) * shares) * stage.length_um).tolist()),
        force_mN=0.0,
        logs=tuple(map(tuple, np.log2(counts).tolist())),
        angle_deg=tuple(angles.tolist()),
    )


def main() -> None:
    """Parse the command line, and print the results."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument(
        "minutes", type=_MINUTES, nargs="?", default=20.0, help="simulated minutes (20)"
    )
    parser.add_argument("--sensor", default="real", help="sensor file: path or name (real)")
    parser.add_argument("--seed", type=int, default=0, help="random seed (0)")
    parser.add_argument(
        "--average",
        type=int,
        default=6,
        help="samples of 10 ms averaged in a reading of the joint (6)",
    )
    options = parser.parse_args()
    sensor = load(SensorFile, options.sensor)
    for minute in joint(sensor, options.minutes, options.seed, options.average):
        print(json.dumps(minute), flush=True)
    for rezeroed in (False, True):
        figures = typing(sensor, options.minutes, options.seed, rezeroed)
        print(json.dumps({"rezeroed": rezeroed, **figures, "typed": ""}), flush=True)


if __name__ == "__main__":
    main()
