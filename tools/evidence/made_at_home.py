"""Measures a strip as its maker uses it: calibrated by hand, and then worn bent in a lit room.

A simulated person calibrates the strip `first` with 45 presses of an indenter, and presses three
marks with a finger. Then it is bent by 45 degrees, and the person presses the marks again in this
pose. Everything happens under 5 uW/cm2 of ambient light. Prints one line of JSON for each hand
(random seed), and then their median or sum:

    PYTHONPATH=tools python -m evidence.made_at_home positions --first-seed 7000 --hands 5
    PYTHONPATH=tools python -m evidence.made_at_home typing 40 60
    PYTHONPATH=tools python -m evidence.made_at_home gestures
    PYTHONPATH=tools python -m evidence.made_at_home dust 0.1 0.3 1 2 --kind rough
"""

from __future__ import annotations

import argparse
import json
from contextlib import contextmanager

import numpy as np

from spots.calibrate.calibration_file import INDENTER
from spots.calibrate.pressers import used_by
from spots.calibrate.session.bench import Bench
from spots.calibrate.session.rezero import rezero
from spots.cli import arguments
from spots.wearable import gestures as g
from spots.wearable.wearable import Mapping, play
from spots_sim.board.identity import board_id
from spots_sim.demo.demo import open_fast
from spots_sim.demo.typing_speed import added, interval_percent, typed
from spots_sim.measure.rezeroed import silent_bench
from spots_sim.measure.rig import Rig
from spots_sim.person.by_hand import PRESSES, calibrate_by_hand
from spots_sim.person.kept import kept
from spots_sim.person.stage_presser import StagePresser
from spots_sim.strip.files import Ambient, Finger, ScenarioFile, SensorFile, load
from spots_sim.strip.scenario import Scenario

from .effects import errors, with_keys

BEND_DEG, LIGHT_UW_CM2 = 45.0, 5.0
FORCES_N = 1.0, 3.0, 6.0
KINDS = {"fine": PRESSES, "rough": 12}  # kind of a session by hand: its number of presses
TOUCHES = 150  # of each hand that types
_READINGS = 12  # at each place
_TREMOR = 0.02  # of a finger that presses, as a share of its force; assumed
_WORLD = {"bend_deg": BEND_DEG, "ambient": Ambient(steps=[(0.0, LIGHT_UW_CM2)])}
_PARTED_S = 5.0  # time constants of contact that sticks, before the strip counts as untouched
_START_S = 4.0  # first gesture
_PAUSE_S = 1.2  # between two gestures
_LATE_S = 1.0  # a gesture may be reported until this time after its end
_RISE_S = 0.03


@contextmanager
def _by_hand(sensor: SensorFile, seed: int, exposure_us: int, kind: str = "fine"):
    """Give a strip (`Rig`) that a simulated person has calibrated, and its `CalibrationFile`."""
    with Rig(sensor, seed, exposure_us, 1) as rig:
        made = calibrate_by_hand(rig.stage, seed, count=KINDS[kind], kind=kind)
        rig.use(made.lines)
        yield rig, made


def _wear(rig: Rig) -> None:
    """Bend a strip; from now on a finger presses it."""
    rig.stage.held.bend_deg = BEND_DEG
    rig.stage.by_hand = True


def _rezeroed(rig: Rig, made) -> tuple[str, ...]:
    """Press the marks in the present pose; return the text lines of the corrected calibration."""
    rig.lift(_PARTED_S)
    rig.stage.held.tremor = _TREMOR
    try:
        bench: Bench = silent_bench(rig.stage, StagePresser(rig.stage))
        return rezero(bench, made).lines
    finally:
        rig.stage.held.tremor = 0.0
        rig.stage.release()


def _lit(sensor: str) -> SensorFile:
    """Return a sensor in the light of the room."""
    return with_keys(load(SensorFile, sensor), {"surroundings.irradiance_uW_cm2": LIGHT_UW_CM2})


@kept(tuple[str, ...])
def _worn_lines(sensor: str, seed: int, exposure_us: int) -> tuple[str, ...]:
    """Return the text lines of a calibration by hand, after a re-zero in the worn pose."""
    with _by_hand(_lit(sensor), seed, exposure_us) as (rig, made):
        _wear(rig)
        lines = _rezeroed(rig, made)
    # In a scenario, the light of the room belongs to the scenario, and not to the sensor.
    own = f"board {board_id(load(SensorFile, sensor))}"
    return tuple(own if line.startswith("board ") else line for line in lines)


def _positions(sensor: str, seed: int, exposure_us: int, readings: int = _READINGS) -> dict:
    """Measure the mean error in mm of each force in five states of a strip.

    An indenter, a finger without and with its marks press the flat strip; the finger presses the
    bent strip, before and after a re-zero.
    """
    found = {}
    with _by_hand(_lit(sensor), seed, exposure_us) as (rig, made):

        def measure(name: str) -> None:
            found[name] = errors(rig, FORCES_N, seed, readings)

        rig.use(used_by(made, INDENTER).lines)
        measure("indenter")
        rig.stage.by_hand = True
        measure("finger without marks")
        rig.use(made.lines)
        measure("finger")
        _wear(rig)
        measure("worn")
        rig.use(_rezeroed(rig, made))
        measure("re-zeroed")
    return {name: [row.error_mm for row in rows] for name, rows in found.items()}


def _dust(sensor: str, percents, seed: int, exposure_us: int, kind: str) -> dict:
    """Measure the mean error in mm for each force, without dust and with dust at one place.

    The place is random. The strip is pressed flat, with an indenter, in the dark.
    """
    bare = load(SensorFile, sensor)
    place_mm = round(float(np.random.default_rng((seed, 3)).uniform(0.1, 0.9)) * bare.length_mm, 1)
    found: dict = {"dust_mm": place_mm}
    for percent in (0.0, *percents):
        dirty = with_keys(bare, {"contact.dust": [[place_mm, percent]] if percent else []})
        with _by_hand(dirty, seed, exposure_us, kind) as (rig, made):
            rig.use(used_by(made, made.presser).lines)
            rows = errors(rig, FORCES_N, seed, _READINGS)
        found[f"{percent:g} %"] = [row.error_mm for row in rows]
    return found


def _moving(seed: int, count: int, length_mm: float) -> tuple[ScenarioFile, list]:
    """Return a scenario of random gestures, and for each its name, start and end in s."""
    rng = np.random.default_rng((seed, 4))
    fingers: list[Finger] = []
    made = []
    now_s = _START_S
    for _ in range(count):
        name = str(rng.choice([g.TAP, g.DOUBLE_TAP, g.HOLD, g.SWIPE_MINUS, g.SWIPE_PLUS]))
        x_mm = to_mm = float(rng.uniform(0.1, 0.9)) * length_mm
        force_mN = float(rng.uniform(1500, 4000))
        held_s = float(rng.uniform(0.08, 0.16))
        if name == g.HOLD:
            held_s = float(rng.uniform(0.8, 1.2))
        elif name in (g.SWIPE_MINUS, g.SWIPE_PLUS):
            held_s = float(rng.uniform(0.15, 0.3))
            middle_mm, half_mm = length_mm / 2, float(rng.uniform(0.14, 0.3)) * length_mm
            half_mm *= -1 if name == g.SWIPE_MINUS else 1
            x_mm, to_mm = middle_mm - half_mm, middle_mm + half_mm
        began_s = now_s
        for _ in range(2 if name == g.DOUBLE_TAP else 1):
            at = [(0.0, x_mm, 0.0), (_RISE_S, x_mm, force_mN)]
            at += [(_RISE_S + held_s, to_mm, force_mN), (2 * _RISE_S + held_s, to_mm, 0.0)]
            fingers.append(Finger(points=[(now_s + s, mm, mN) for s, mm, mN in at]))
            ended_s = now_s + 2 * _RISE_S + held_s
            now_s = ended_s + float(rng.uniform(0.08, 0.15))
        made.append((name, began_s, ended_s))
        now_s = ended_s + _PAUSE_S
    return ScenarioFile(seconds=now_s + 1.0, touch=fingers, **_WORLD), made


def _gestures(sensor: str, seed: int, exposure_us: int, count: int) -> dict:
    """Count random gestures of five kinds on a worn strip that are recognised, and others."""
    file, made = _moving(seed, count, load(SensorFile, sensor).length_mm)
    lines = _worn_lines(sensor, seed, exposure_us)
    board, _ = open_fast(sensor, Scenario(file), seed, lines=lines)
    with board:
        found = play(board, lambda one: None, file.seconds - board.now_s(), False, Mapping())
    times_s = [board_time_s for *_, board_time_s in found]
    right = 0
    for name, began_s, ended_s in made:
        here = [
            one.name for one, time_s in zip(found, times_s) if began_s < time_s < ended_s + _LATE_S
        ]
        right += here == [name]
    return {"gestures": count, "right": right, "found": len(found)}


def _median(rows: list[dict]) -> dict:
    found = {}
    for name, value in rows[0].items():
        if isinstance(value, list):
            found[name] = np.median([row[name] for row in rows], axis=0).round(3).tolist()
    return found


def main() -> None:
    """Parse the command line, and print the results."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("what", choices=("positions", "typing", "gestures", "dust"))
    parser.add_argument(
        "values",
        nargs="*",
        type=float,
        help="speeds in words a minute (40 60), or shares of dust in per cent (0.1 0.3 1 2)",
    )
    parser.add_argument("--sensor", default="first", help="sensor file: path or name (first)")
    parser.add_argument("--hands", type=int, default=5, help="number of simulated persons (5)")
    parser.add_argument("--first-seed", type=arguments.seed, default=7000, help="(7000)")
    parser.add_argument("--exposure-us", type=arguments.exposure_us, default=10_000)
    parser.add_argument("--kind", choices=KINDS, default="fine", help="session for dust (fine)")
    parser.add_argument("--touches", type=int, default=TOUCHES, help="touches of a hand (150)")
    options = parser.parse_args()
    seeds = range(options.first_seed, options.first_seed + options.hands)
    sensor, exposure_us = options.sensor, options.exposure_us
    if options.what == "typing":
        for speed in options.values or (40.0, 60.0):
            runs = []
            for seed in seeds:
                lines = _worn_lines(sensor, seed, exposure_us)
                what = speed, options.touches, seed, sensor
                runs.append(typed(*what, lines=lines, world=_WORLD))
            print(json.dumps({"words_per_min": speed, **added(runs)}), flush=True)
        return
    rows = []
    for seed in seeds:
        if options.what == "positions":
            rows.append(_positions(sensor, seed, exposure_us))
        elif options.what == "dust":
            percents = options.values or (0.1, 0.3, 1.0, 2.0)
            rows.append(_dust(sensor, percents, seed, exposure_us, options.kind))
        else:
            rows.append(_gestures(sensor, seed, exposure_us, options.touches))
        print(json.dumps({"seed": seed, **rows[-1]}), flush=True)
    if options.what == "gestures":
        total, right = (sum(row[name] for row in rows) for name in ("gestures", "right"))
        low, high = interval_percent(right, total)
        share = {"right_percent": round(100 * right / total, 2), "interval": [low, high]}
        print(json.dumps(share))
    else:
        print(json.dumps({"forces_N": FORCES_N, "median_error_mm": _median(rows)}))


if __name__ == "__main__":
    main()
