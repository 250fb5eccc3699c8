"""The compensation of hysteresis and creep: exact, within 31 bits, off without ``silicone``."""

import math

import pytest
from support.calibration_lines import GOOD
from support.refusals import refusal
from support.smallint import SmallInt, small

from spots_device.reading.calibration import Calibration
from spots_device.reading.calibration_lines import CalibrationError
from spots_device.reading.decode import (
    FLAGS,
    FORCE_MN,
    LED_OFF,
    POSITION_UM,
)
from spots_device.reading.silicone import Compensation

ONE = 4096


def compensation(gain=ONE, play=(300, 0), creep=(1000, 0)):
    """Return a compensation with only one play operator and one part of the creep.

    `gain`, and the second values of `play` and `creep`, are in Q12. The first value of `play` is
    the operator's half width in mN, that of `creep` its time constant in ms.
    """
    return Compensation((gain, play[0], 0, 0, play[1], 0, 0, creep[0], 1, 1, creep[1], 0, 0))


def taken(made, force_mN, t, position_um=40_000, flags=0):
    reading = {FORCE_MN: force_mN, POSITION_UM: position_um, FLAGS: flags}
    made.take(reading, t)
    return reading[FORCE_MN]


def test_a_calibration_without_its_lines_compensates_nothing():
    assert Calibration(GOOD).compensation is None


def test_a_gain_of_one_changes_no_force():
    made = compensation()
    for i, force_mN in enumerate((0, 1, 200, 9000, 65_535, 3000, 0, 500)):
        assert taken(made, force_mN, 10 * i) == force_mN


def test_unloading_is_corrected_by_a_play_operator_that_restarts_with_each_touch():
    made = compensation(play=(300, 2048))
    # Unloading by 600 mN moves the operator from 300 below the force to 300 above it.
    forces = [taken(made, force, 10 * i) for i, force in enumerate((1000, 2000, 1800, 1400, 1000))]
    assert forces == [1000, 2000, 1700, 1100, 700]
    taken(made, 0, 60)
    assert taken(made, 1000, 70) == 1000


def test_creep_is_subtracted_grows_and_recovers():
    made = compensation(creep=(1024, 400))  # a time constant of about a second
    held = [taken(made, 5000, 10 * i) for i in range(500)]
    assert held[0] == 5000
    # The subtracted part creeps less, so the time constant is shorter: 4096 / 4496 of it.
    grown = 1 - math.exp(-4496 / 4096)
    assert held[100] == pytest.approx(5000 - grown * 5000 * 400 / 4496, abs=5)
    assert held[-1] == pytest.approx(5000 * 4096 / 4496, abs=8)
    for i in range(500, 700):
        assert taken(made, 0, 10 * i) == 0
    assert taken(made, 5000, 7000) == pytest.approx(5000 - 450 * 0.135, abs=15)


def test_another_place_has_not_crept():
    made = compensation(creep=(1024, 400))
    for i in range(500):
        taken(made, 5000, 10 * i)
    assert taken(made, 5000, 5000, position_um=52_000) == 5000


def test_a_dark_window_is_no_lift():
    made = compensation(play=(300, 2048))
    taken(made, 3000, 0)
    taken(made, 2400, 10)
    assert taken(made, 0, 20, flags=LED_OFF) == 0
    assert taken(made, 2400, 30) == 2100


def test_a_long_gap_takes_few_steps_and_the_time_may_wrap():
    made = compensation(creep=(1024, 400))
    taken(made, 5000, (1 << 22) - 20)
    assert taken(made, 5000, 80) < 4975
    taken(made, 0, 90)
    assert taken(made, 5000, 3_000_000) > 4990


@pytest.mark.parametrize("sign", [1, -1])
def test_the_largest_weights_and_forces_stay_inside_31_bits(sign):
    share = ((1 << 14) - 1) // 3
    made = compensation(share, (65_535, sign * share), ((1 << 20) - 1, -sign * share))
    for name, values in vars(made).items():
        setattr(made, name, SmallInt(values) if isinstance(values, int) else small(values))
    t = 0
    for force_mN in (65_535, 65_535, 1, 65_535, 0, 65_535) * 3:
        t += 5000
        assert 0 <= taken(made, SmallInt(force_mN), SmallInt(t), SmallInt(5)) <= 65_535


@pytest.mark.parametrize(
    ("at", "value"), [(0, 16_000), (1, -1), (4, -13_000), (7, 0), (8, 1 << 20), (12, 13_000)]
)
def test_a_value_out_of_range_is_refused(at, value):
    values = [4096, 300, 1000, 3000, 400, 0, 150, 400, 4000, 40_000, 60, 50, 0]
    assert Calibration([*GOOD, line(values)]).compensation
    values[at] = value
    with refusal(CalibrationError):
        Calibration([*GOOD, line(values)])


def line(values):
    return " ".join(map(str, ("silicone", *values)))
