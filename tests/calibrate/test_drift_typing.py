"""Typing on a strip that has drifted and was not re-zeroed: keys still follow the positions."""

from collections import Counter

import numpy as np
import pytest
from msgspec.structs import replace

from spots.controller.gamepad_engine import usable
from spots.keyboard.key_engine import KeyEngine
from spots.keyboard.keys import push
from spots.keyboard.layout import load
from spots.link.board import Board
from spots.link.connect import prepare
from spots.link.frames import Key, Touch
from spots_sim.board.lockstep import LockstepLink
from spots_sim.measure.rezeroed import recalibrated
from spots_sim.person.typist import TypedText
from spots_sim.strip.change import NAMES, Change
from spots_sim.strip.files import (
    ChangeInTime,
    Finger,
    ScenarioFile,
    SensorFile,
)
from spots_sim.strip.files import load as load_file
from spots_sim.strip.scenario import Scenario

DIGITS, FORCE_MN = "1234567890", 2000
TEXT = "50284917630918273645"
START_S, PERIOD_S, RISE_S = 3.0, 0.3, 0.02
UNTRUSTED = ("die redder", "die bluer", "more blue", "mix")
DRIFTS = {
    "die redder": {"die_nm": 1.0},
    "die bluer": {"die_nm": -1.0},
    "phosphor redder": {"phosphor_nm": 1.0},
    "phosphor bluer": {"phosphor_nm": -1.0},
    "more blue": {"blue_share_percent": 2.0},
    "filters": {"bands_nm": 0.3},
    "tilt": {"tilt_percent": 0.5},
    "bleached": {"dye_percent": -5.0},
    "mix": {
        "die_nm": 0.5,
        "phosphor_nm": 0.5,
        "blue_share_percent": 1.0,
        "bands_nm": 0.15,
        "tilt_percent": 0.25,
        "dye_percent": -2.5,
    },
}


class Events:
    def __init__(self):
        self.events = []

    def key(self, *event):
        self.events.append(event)


def tap(x_mm, at_s, held_s):
    points = [(0, 0), (RISE_S, FORCE_MN), (held_s - RISE_S, FORCE_MN), (held_s, 0)]
    return Finger(points=[(at_s + time_s, x_mm, force) for time_s, force in points])


def play(sensor, lines, change, held_s=0.15, alone=0):
    """Type `TEXT` on a drifted strip.

    Parameters
    ----------
    sensor : SensorFile
        The simulated strip.
    lines : sequence of str
        Lines of its calibration, made before the drift.
    change : dict
        Drift by name, see `ChangeInTime`.
    held_s : float
        Duration of a tap, in s.
    alone : int
        Number of taps at the beginning that do not overlap the following tap.

    Returns
    -------
    typed : list of str
        The typed key of each tap.
    touches : list of Touch
        All readings.
    """
    seconds = START_S + PERIOD_S * len(TEXT)
    fingers = []
    for i, key in enumerate(TEXT):
        x_mm = sensor.length_mm * (DIGITS.index(key) + 0.5) / len(DIGITS)
        fingers.append(tap(x_mm, START_S + PERIOD_S * i, 0.15 if i < alone else held_s))
    drift = ChangeInTime(**{name: [(0.0, change[name])] for name in NAMES if name in change})
    file = ScenarioFile(seconds=seconds + 1, touch=fingers, change=drift)
    there, here, touches = Events(), Events(), []
    typed = [""] * len(TEXT)
    with Board(LockstepLink(sensor, Scenario(file), seed=1)) as board:
        prepare(board, lines)
        layout = load("digits")
        push(board, layout)
        engine = KeyEngine(layout, board.command("hello")["length_um"], here)
        board.command("stream touch")
        for frame in board.frames(seconds - board.now_s()):
            if isinstance(frame, Touch):
                engine.take(frame, board.now_s())
                if frame.touching:
                    touches.append(frame)
            elif isinstance(frame, Key):
                there.key(*frame[3:7])
                if frame.pressed:
                    text = TypedText()
                    text.key(*frame[3:7])
                    typed[int((frame.time_s - START_S) / PERIOD_S)] += text.text
    assert here.events == there.events
    return typed, touches


def counted(typed, text=TEXT):
    return Counter(
        "right" if got == wanted else "wrong" if got else "silent"
        for wanted, got in zip(text, typed)
    )


@pytest.mark.board
@pytest.mark.parametrize("name", DRIFTS)
def test_a_drift_that_hits_the_right_key_types_it(sensor, calibration, name):
    typed, touches = play(sensor, calibration, DRIFTS[name])
    found = counted(typed)
    print(name, dict(found))
    # Two touches must agree before the drift is used, so the first touch may type nothing.
    assert counted(typed[1:], TEXT[1:]) == {"right": len(TEXT) - 1}
    assert typed[0] in ("", TEXT[0])
    if name in UNTRUSTED:
        firm = [touch.trusted for touch in touches if touch.force_mN > 1500]
        assert sum(firm) < 0.05 * len(firm)


@pytest.mark.board
def test_a_strip_of_little_contrast_types_right_after_a_re_zero():
    change = {"phosphor_nm": -1.0}
    sensor = load_file(SensorFile, "weak_dye")
    lines = recalibrated(replace(sensor, change=Change(**change)))
    assert counted(play(sensor, lines, change)[0]) == {"right": len(TEXT)}


@pytest.mark.board
def test_a_controller_follows_a_strip_that_drifted(sensor, calibration):
    _, touches = play(sensor, calibration, DRIFTS["die redder"])
    third_s = START_S + 2 * PERIOD_S
    firm = [touch for touch in touches if touch.force_mN > 1500 and touch.time_s > third_s]
    assert len(firm) > 100
    assert np.mean([usable(touch) for touch in firm]) > 0.95


def test_a_controller_follows_slow_presses_on_a_strip_that_drifted(sensor, calibration):
    # The first readings of a slow press are faint: their noise must not change the measured drift.
    rise = [(0, 0), (0.2, 800), (0.4, 4000), (0.6, 4000), (0.65, 0)]
    fingers = [
        Finger(points=[(1 + i + time_s, 10.0 * (i + 1), force) for time_s, force in rise])
        for i in range(6)
    ]
    drift = ChangeInTime(die_nm=[(0.0, 0.7)])
    scenario = Scenario(ScenarioFile(seconds=8, touch=fingers, change=drift))
    with Board(LockstepLink(sensor, scenario, seed=1)) as board:
        prepare(board, calibration)
        board.command("stream touch")
        readings = [frame for frame in board.frames(7.0 - board.now_s()) if frame.time_s > 3.0]
    firm = [touch for touch in readings if touch.force_mN > 1500]
    assert len(firm) > 100
    assert np.mean([touch.trusted for touch in firm]) < 0.5
    assert np.mean([usable(touch) for touch in firm]) > 0.95


@pytest.mark.board
def test_a_drift_that_hits_another_key_is_not_hidden(sensor, calibration):
    typed, _ = play(sensor, calibration, {"blue_share_percent": 10.0})
    assert counted(typed) == {"silent": len(TEXT)}


@pytest.mark.board
@pytest.mark.parametrize("name", ["filters", "more blue"])
def test_two_fingers_in_turn_on_a_drifted_strip_are_two_keys(sensor, calibration, name):
    typed, _ = play(sensor, calibration, DRIFTS[name], held_s=PERIOD_S + 0.05, alone=2)
    assert counted(typed[1:], TEXT[1:]) == {"right": len(TEXT) - 1}
