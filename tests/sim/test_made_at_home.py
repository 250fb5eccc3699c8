"""The measurement of a strip made at home: its random gestures."""

import pytest

from evidence import made_at_home
from spots.wearable import gestures as g
from spots_sim.strip.scenario import Scenario


@pytest.mark.parametrize("seed", [1, 2])
def test_random_gestures_follow_each_other_on_a_bent_strip_in_light(seed):
    file, made = made_at_home._moving(seed, 40, 85.0)
    assert {name for name, _, _ in made} == {
        g.TAP, g.DOUBLE_TAP, g.HOLD, g.SWIPE_MINUS, g.SWIPE_PLUS
    }  # fmt: skip
    assert len(file.touch) == 40 + sum(name == g.DOUBLE_TAP for name, _, _ in made)
    pauses_s = [after[1] - before[2] for before, after in zip(made, made[1:])]
    assert min(pauses_s) > made_at_home._LATE_S
    scenario = Scenario(file)
    assert scenario.pose(1.0).bend_deg == made_at_home.BEND_DEG
    assert scenario.ambient_uW_cm2(1.0, 1.1) == made_at_home.LIGHT_UW_CM2
    for name, began_s, ended_s in made:
        first, last = (scenario.presses(t) for t in (began_s + 0.02, ended_s - 0.02))
        moved_mm = last[0].position_mm - first[0].position_mm
        assert (moved_mm > 14) == (name == g.SWIPE_PLUS)
        assert (moved_mm < -14) == (name == g.SWIPE_MINUS)
