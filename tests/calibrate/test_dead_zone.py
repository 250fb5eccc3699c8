"""A touch begins just above the dead zone: light taps are typed, and lamps cause no touch.

The dead zone is the least force that gives a reading.
"""

import numpy as np
import pytest

from spots.keyboard.keys import push
from spots.keyboard.layout import load as load_layout
from spots.link.board import Board
from spots.link.connect import prepare
from spots.link.frames import Key, Touch
from spots_device.reading.calibration import Calibration
from spots_sim.board.lockstep import LockstepLink
from spots_sim.measure.measurements import _threshold_mN
from spots_sim.measure.rig import Rig
from spots_sim.person.typist import TypedText
from spots_sim.strip.files import Ambient, Finger, ScenarioFile
from spots_sim.strip.scenario import Scenario

pytestmark = pytest.mark.board

DIGITS = "1234567890"
START_S, PERIOD_S, HELD_S, RISE_S = 3.0, 0.3, 0.15, 0.02


def played(sensor, lines, scenario, streams=""):
    """Play a scenario on a board with the layout `digits`; yield the board's frames.

    Parameters
    ----------
    sensor : SensorFile
        The simulated strip.
    lines : sequence of str
        Lines of its calibration.
    scenario : ScenarioFile
        Fingers and ambient light.
    streams : str
        Kinds of frames to stream, for the command ``stream``.
    """
    with Board(LockstepLink(sensor, Scenario(scenario), seed=1)) as board:
        prepare(board, lines)
        push(board, load_layout("digits"))
        if streams:
            board.command("stream " + streams)
        yield from board.frames(scenario.seconds - board.now_s())


def test_a_touch_begins_at_most_at_1_3_times_the_dead_zone(sensor):
    with Rig(sensor, 0, 10_000, 1) as rig:
        dead_mN = _threshold_mN(rig)
        begins = Calibration(rig.lines).touch_on_mN
        print(dead_mN, begins)
        assert begins <= 1.3 * dead_mN
        rig.stage.release()
        readings, _ = rig.readings(rig.stage.length_um / 2, 1.05 * begins, 3)
        assert all(r.touching for r in readings)


@pytest.mark.parametrize("seed", [1, 2])
def test_forty_of_forty_light_taps_are_typed(sensor, calibration, seed):
    rng = np.random.default_rng(seed)
    wanted, fingers = "", []
    for i in range(40):
        key, start_s = rng.integers(10), START_S + PERIOD_S * i
        wanted += DIGITS[key]
        x_mm = sensor.length_mm * (key + rng.uniform(0.1, 0.9)) / 10
        force_mN = rng.uniform(300, 420)
        points = [(0, 0), (RISE_S, force_mN), (HELD_S - RISE_S, force_mN), (HELD_S, 0)]
        fingers.append(Finger(points=[(start_s + t, x_mm, f) for t, f in points]))
    text = TypedText()
    for frame in played(
        sensor, calibration, ScenarioFile(seconds=START_S + PERIOD_S * 40, touch=fingers)
    ):
        if isinstance(frame, Key):
            text.key(*frame[3:7])
    assert text.text == wanted


@pytest.mark.parametrize(("flicker_percent", "flicker_hz"), [(0, 100), (100, 120)])
def test_a_lamp_that_is_switched_on_is_no_touch(sensor, calibration, flicker_percent, flicker_hz):
    # Without `mains_hz`, with an exposure of 10 ms, the flicker of 120 Hz changes the counts.
    levels = (0, 95, 0, 110, 0, 130, 0, 150)
    steps = [(5.003 * i, level) for i, level in enumerate(levels)]
    lamp = Ambient(steps=steps, flicker_percent=flicker_percent, flicker_hz=flicker_hz)
    scenario = ScenarioFile(seconds=40.0, ambient=lamp)
    begun, touching = 0, False
    for frame in played(sensor, calibration, scenario, "touch"):
        if isinstance(frame, Touch):
            begun += frame.touching and not touching
            touching = frame.touching
        assert not isinstance(frame, Key)
    assert begun == 0
