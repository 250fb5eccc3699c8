"""Ambient light that moves: sun through leaves, and the shadow of a hand."""

from difflib import SequenceMatcher

import msgspec
import pytest

from spots.advice.advice import Advice
from spots.link.board import Board
from spots.link.connect import prepare
from spots.wearable import gestures as g
from spots_sim.board.lockstep import LockstepLink
from spots_sim.strip.files import Ambient, ScenarioFile, load
from spots_sim.strip.scenario import Scenario

ONCE = [
    g.TAP, g.DOUBLE_TAP, g.HOLD, g.SQUEEZE,
    g.SWIPE_PLUS, g.SWIPE_MINUS, g.SLIDE_PLUS, g.SLIDE_MINUS,
]  # fmt: skip


@pytest.mark.board
@pytest.mark.parametrize("irradiance_uW_cm2", [3.0, 10.0, 20.0])
def test_all_gestures_are_found_and_no_rezero_is_advised(
    sensor, calibration, irradiance_uW_cm2, capsys
):
    leaves = Ambient(steps=[(0.0, irradiance_uW_cm2)], leaves_percent=80.0)
    worn = load(ScenarioFile, "worn")
    scene = ScenarioFile(seconds=worn.seconds, touch=worn.touch, ambient=leaves)
    found, gestures, advice = [], g.Gestures(), Advice()
    with Board(LockstepLink(sensor, Scenario(scene), 1)) as board:
        prepare(board, calibration)
        board.command("stream touch")
        for touch in board.touches(worn.seconds - board.now_s()):
            advice.warn(touch, board.now_s())
            found += gestures.take(touch, board.now_s())
    names = [one.name for one in found]
    same = SequenceMatcher(None, names, 2 * ONCE, autojunk=False).get_matching_blocks()
    right = sum(block.size for block in same)
    # In the strongest light, a swipe became a tap and a slide with another calibration.
    assert right >= len(2 * ONCE) - (irradiance_uW_cm2 > 10)
    assert len(names) <= right + 2
    assert capsys.readouterr().err == ""


@pytest.mark.board
def test_moving_light_alone_is_no_touch(sensor, calibration):
    leaves = Ambient(steps=[(0.0, 20.0)], leaves_percent=80.0, leaves_hz=2.0)
    scene = ScenarioFile(seconds=60.0, ambient=leaves)
    with Board(LockstepLink(sensor, Scenario(scene), 2)) as board:
        prepare(board, calibration)
        board.command("stream touch")
        readings = list(board.touches(25.0))
    assert len(readings) > 2000
    assert not any(touch.touching for touch in readings)


@pytest.mark.board
def test_a_hand_that_shades_while_it_presses(sensor, calibration):
    """At 50 uW/cm2 the shadow takes more light than a press of 1 N gives in the dimmest channel."""
    points = [(3 + i, 0.0) for i in range(8)]
    taps = [
        msgspec.convert(
            {
                "points": [
                    (t, 60.0, 0),
                    (t + 0.03, 60.0, 1500),
                    (t + 0.4, 60.0, 1500),
                    (t + 0.43, 60.0, 0),
                ]
            },
            type(load(ScenarioFile, "worn").touch[0]),
        )
        for t, _ in points
    ]
    light = Ambient(steps=[(0.0, 50.0)], shaded_percent=50.0)
    scene = ScenarioFile(seconds=12.0, touch=taps, ambient=light)
    with Board(LockstepLink(sensor, Scenario(scene), 3)) as board:
        prepare(board, calibration)
        board.command("stream touch")
        readings = list(board.touches(11.5 - board.now_s()))
    for t, _ in points:
        during = [r for r in readings if t + 0.15 < r.time_s < t + 0.4]
        trusted = [r for r in during if r.touching and r.trusted]
        assert len(trusted) > 0.7 * len(during)
        assert abs(sum(r.position_um for r in trusted) / len(trusted) - 60_000) < 400
