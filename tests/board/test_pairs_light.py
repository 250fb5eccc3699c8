"""Any two actions under two fingers, through light, firmware and USB reports, on board and host."""

import os
from pathlib import Path

import numpy as np
import pytest
from support.boards import store
from support.computer import Computer, text_of
from support.pairs import ACTIONS, some

from spots.keyboard.key_engine import KeyEngine
from spots.keyboard.keys import push
from spots.keyboard.layout import compiled
from spots.link.board import Board
from spots.link.frames import Touch
from spots_sim.board.lockstep import LockstepLink
from spots_sim.strip.files import Finger, ScenarioFile
from spots_sim.strip.scenario import Scenario

pytestmark = pytest.mark.board

PAIRS = int(os.environ.get("SPOTS_PAIRS", "30"))
KEYS = 7  # of a layout, 12 mm wide
OF_LAYOUT = 10  # pairs with the same layout
START_S, BETWEEN_S, RAMP_S, FORCE_MN = 3.0, 0.7, 0.015, 1800
PAUSE_S = 1.2  # without fingers, while the next layout is uploaded


def planned(rng, length_mm):
    """Return the batches: (start, end, actions of the layout, pairs); and all fingers."""
    batches, fingers, now_s = [], [], START_S
    while len(batches) * OF_LAYOUT < PAIRS:
        # A computer that got these actions would not show the difference to another program.
        actions = [str(name) for name in rng.permutation([a for a in ACTIONS if chars(a)])[:KEYS]]
        pairs = some(rng, OF_LAYOUT, actions)
        began_s = now_s
        for i, pair in enumerate(pairs):
            if pair.a == pair.b:  # two fingers on one key are one finger
                pairs[i] = pair = pair._replace(b=actions[actions.index(pair.a) - 3])
            down = {}
            for is_press, name in pair.events:
                now_s += rng.uniform(0.09, 0.16)
                if is_press:
                    down[name] = now_s
                    continue
                key = actions.index(getattr(pair, name))
                x_mm = length_mm * (key + rng.uniform(0.35, 0.65)) / KEYS
                at_s = down.pop(name)
                times = (at_s, at_s + RAMP_S, now_s, now_s + RAMP_S)
                forces = (0, FORCE_MN, FORCE_MN, 0)
                fingers.append(Finger(points=[(t, x_mm, f) for t, f in zip(times, forces)]))
            now_s += BETWEEN_S
        batches.append((began_s, now_s, actions, pairs))
        now_s += PAUSE_S
    return batches, fingers, now_s


def chars(action):
    return action not in ("VOLUME_INCREMENT", "MUTE")  # media keys have no reports of a keyboard


def test_any_two_actions_under_two_fingers_type_what_each_of_them_means(
    sensor, calibration, tmp_path
):
    batches, fingers, end_s = planned(np.random.default_rng(3), sensor.length_mm)
    store(tmp_path, calibration=calibration, settings=["keys=1"])
    scenario = Scenario(ScenarioFile(seconds=end_s + 1, touch=fingers))
    wrong = []
    with Board(LockstepLink(sensor, scenario, seed=1, folder=tmp_path)) as board:
        board.command("hello")
        reports = board._link.usb.reports
        for began_s, ended_s, actions, pairs in batches:
            keys = ", ".join(f'"{name}"' for name in actions)
            layout = compiled(Path("x"), f'name = "x"\n[[layer]]\nname = "a"\nkeys = [{keys}]\n')
            push(board, layout)
            info = board.command("hello")
            computer, before = Computer(), len(reports)
            engine = KeyEngine(
                layout, info["length_um"], computer, info["decay"], cross=info["cross"]
            )
            board.command("stream touch")
            assert board.now_s() < began_s
            for frame in board.frames(ended_s - board.now_s()):
                if isinstance(frame, Touch):
                    engine.take(frame, board.now_s())
            assert not computer.down
            typed = [data for number, data in reports[before:] if number == 0]
            wanted = "".join(pair.text() for pair in pairs)
            if not wanted == text_of(typed) == computer.text:
                wrong.append((pairs, wanted, text_of(typed), computer.text))
    assert not wrong, wrong
