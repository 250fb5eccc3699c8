"""Counts touches that a board reports although no finger touches the strip.

    python tests/soak/false_touches.py --hours 1

The scenes are a room, lamps, and a moving arm; each lasts `--hours` of simulated time. Prints one
line of JSON for each scene: the number of touches, the number of readings of the longest touch, the
number of pressed keys, and the number of changes of the light. `--touch-mN` replaces the forces of
the calibration at which a touch begins and ends. The exit code is 1 if a key was pressed.
"""

from __future__ import annotations

import argparse
import json
import sys

import msgspec
import numpy as np

from spots.keyboard.keys import push
from spots.keyboard.layout import load as load_layout
from spots.link.board import Board
from spots.link.connect import prepare
from spots.link.frames import Key, Touch
from spots_sim.board.lockstep import LockstepLink
from spots_sim.person.stage import calibrate
from spots_sim.strip.files import (
    Ambient,
    ScenarioFile,
    SensorFile,
    load,
)
from spots_sim.strip.scenario import Scenario

_PART_S = 300.0  # a scene is played in parts, each with another seed and another lamp
_START_S = 4.0  # the light does not change before this time; the board then has its calibration


def _room(rng: np.random.Generator) -> ScenarioFile:
    # Assumed: daylight and shadows change the light by a few per cent a second, and sometimes by a
    # factor of up to 3; the light of the room's lamps flickers.
    times_s = np.arange(_START_S, _PART_S)
    change = 0.05 * rng.standard_normal(len(times_s))
    change[rng.random(len(times_s)) < 1 / 40] += rng.uniform(-1.1, 1.1)
    level = np.log(2.0)
    steps = [(0.0, 2.0)]
    for time_s, one in zip(times_s.tolist(), change.tolist()):
        level = min(max(level + one, np.log(0.3)), np.log(20.0))
        steps.append((time_s, float(np.exp(level))))
    return _lit(rng, steps, 30.0)


def _lamps(rng: np.random.Generator) -> ScenarioFile:
    # Assumed: a lamp of any brightness is switched on and off every 5 to 30 s.
    time_s, on = _START_S, False
    steps = [(0.0, 0.0)]
    while time_s < _PART_S:
        on = not on
        level = float(np.exp(rng.uniform(np.log(0.5), np.log(150.0)))) if on else 0.0
        steps.append((time_s, level))
        time_s += float(rng.uniform(5.0, 30.0))
    return _lit(rng, steps, float(rng.choice((0.0, 30.0, 100.0))))


def _arm(rng: np.random.Generator) -> ScenarioFile:
    return msgspec.structs.replace(load(ScenarioFile, "arm"), touch=[])


def _lit(rng, steps: list[tuple[float, float]], flicker_percent: float) -> ScenarioFile:
    light = Ambient(
        steps=steps,
        flicker_percent=flicker_percent,
        flicker_hz=float(rng.choice((100.0, 120.0))),
        flicker_phase_deg=float(rng.uniform(0.0, 360.0)),
    )
    return ScenarioFile(seconds=_PART_S, ambient=light)


_SCENES = {"room": _room, "lamps": _lamps, "arm": _arm}


def _played(sensor: SensorFile, lines: list[str], scene: ScenarioFile, seed: int, seconds: float):
    """Play a scene; return the number of readings of each touch, and the number of pressed keys."""
    lasted: list[int] = []
    touching, keys = False, 0
    with Board(LockstepLink(sensor, Scenario(scene), seed)) as board:
        prepare(board, lines)
        push(board, load_layout("digits"))
        board.command("stream touch")
        for frame in board.frames(seconds - board.now_s()):
            if isinstance(frame, Key):
                keys += frame.pressed
            elif isinstance(frame, Touch):
                if frame.touching:
                    if not touching:
                        lasted.append(0)
                    lasted[-1] += 1
                touching = frame.touching
    return lasted, keys


def main(arguments: list[str] | None = None) -> int:
    """Count the touches of each scene; return the exit code."""
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("--hours", type=float, default=1.0, help="simulated time of a scene (1)")
    parser.add_argument("--scenes", default=",".join(_SCENES), help="scenes to play")
    parser.add_argument("--sensor", default="default", help="sensor file or name")
    parser.add_argument("--seed", type=int, default=0, help="random seed (0)")
    parser.add_argument(
        "--touch-mN", dest="touch_mN", help="BEGIN,END: forces in mN at which touches begin and end"
    )
    options = parser.parse_args(arguments)
    sensor = load(SensorFile, options.sensor)
    lines = list(calibrate(sensor))
    if options.touch_mN:
        forces = "touch " + options.touch_mN.replace(",", " ")
        lines = [forces if line.startswith("touch ") else line for line in lines]
    pressed = 0
    for name in options.scenes.split(","):
        lasted: list[int] = []
        keys, changes, left_s, part = 0, 0, 3600.0 * options.hours, 0
        while left_s > 0:
            rng = np.random.default_rng((options.seed, list(_SCENES).index(name), part))
            scene, seconds = _SCENES[name](rng), min(left_s, _PART_S)
            found, more = _played(sensor, lines, scene, options.seed + part, seconds)
            lasted, keys = lasted + found, keys + more
            steps = scene.ambient.steps if scene.ambient else []
            changes += sum(0 < step[0] <= seconds for step in steps)
            left_s, part = left_s - _PART_S, part + 1
        begun = {"touches": len(lasted), "longest": max(lasted, default=0)}
        begun |= {"keys": keys, "changes": changes}
        print(json.dumps({"scene": name, "hours": options.hours, **begun}), flush=True)
        pressed += keys
    return int(pressed > 0)


if __name__ == "__main__":
    sys.exit(main())
