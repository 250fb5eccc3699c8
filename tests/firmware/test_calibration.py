"""A calibration is accepted only if every line is valid."""

from array import array

import pytest
from support.calibration_lines import GOOD
from support.refusals import refusal
from support.smallint import SmallInt

from spots.calibrate.fit.decoded import bounds_of, segments_of
from spots_device.reading.calibration import Calibration, Conditions
from spots_device.reading.calibration_lines import CalibrationError


def changed(old, new):
    return "\n".join(GOOD).replace(old, new, 1).split("\n")


@pytest.mark.board
def test_the_real_one_is_good(calibration):
    made = Calibration(calibration)
    assert made.conditions.plan == ("F3", "F4", "F5", "F6", "F7", "F8")
    assert made.length_um == 85_000
    assert min(min(part.positions_um) for part in segments_of(made)) == 0


def test_segments_have_weights_and_tables_of_their_own():
    first, second = segments_of(Calibration(GOOD))
    assert first.position.tolist() == [-8192, 0, 0, 0, 0, 8192]
    assert second.force.tolist() == [0, 0, 0, 0, 8192, 0]
    assert second.contrasts.tolist() == [90_000, 200_000]
    assert second.offsets.tolist() == [0, -100]


def test_a_known_strain_is_its_own_block():
    made = Calibration(GOOD, 100_000)
    assert bounds_of(made) == [0, 70_000]
    assert segments_of(made)[1].positions_um.tolist() == [7700, 17_600]
    assert made.length_um == 17_600


def test_between_two_strains_everything_goes_in_straight_lines():
    made = Calibration(GOOD, 50_000)
    assert bounds_of(made) == [0, 80_000]
    assert segments_of(made)[0].contrasts.tolist() == [0, 90_000]
    assert segments_of(made)[0].positions_um.tolist() == [0, 8400]
    assert segments_of(made)[0].offsets.tolist() == [200, 300]


def test_the_light_without_a_press_is_optional():
    assert Calibration(GOOD).baseline == ()
    assert Calibration([*GOOD, "rest 640 0 1 2 3 4194240"]).baseline == (640, 0, 1, 2, 3, 4_194_240)


@pytest.mark.parametrize("strain_ppm", [-1, 100_001])
def test_a_strain_beyond_the_known_ones_is_refused(strain_ppm):
    with refusal(CalibrationError):
        Calibration(GOOD, strain_ppm)


@pytest.mark.parametrize(
    ("old", "new", "says"),
    [
        ("fit 8192 -8192 0 0 0 0\n", "", "missing"),
        ("touch 300 200", "touch 200 300", "begin"),
        ("touch 300 200", "touch 300 0", "begin"),
        ("touch 300 200", "touch 300", "2 integers"),
        ("touch 300 200", "touch 300 200\nrest 1 2 3 4 5", "6 integers"),
        ("touch 300 200", "touch 300 200\nrest 1 2 3 4 5 -1", "sums of 'rest' must be from 0"),
        ("touch 300 200", "touch 300 200\nrest 1 2 3 4 5 4194241", "sums of 'rest' must be from 0"),
        ("touch 300 200", "touch 300 many", "2 integers"),
        ("x 0 0 5 100", "x 0 0 5", "4 or 6 integers"),
        ("coarse -4096", "coarse -4095", "add up to 0"),
        ("0 8192\nsegment", "0 8193\nsegment", "add up to 8192"),
        ("fit 8192 -8192", "fit 80000 -80000", "too large"),
        ("x 100000 8000", "x 0 8000", "ascend"),
        ("x 100000 8000", "x 100000 0", "monotone"),
        ("x 100000 8000", "x 1000000 8000", "too far apart"),
        ("x 100000 8000", "x 268435457 8000", "up to 2"),
        ("x 100000 8000 5 200\n", "", "same number of knots|2 to 128"),
        ("from 90000", "from 0", "must ascend"),
        ("f 1000 200 900", "f 1000 -200 900", "forces of 'f'"),
        ("f 100000 6000 90", "f 10000 70000 90", "forces of 'f'"),
        ("segment -8192", "# -8192", "not a line"),
        ("segment 0 -8192 0 0 0 8192 0 0 0 0 8192 0\n", "", "one 'from' for each"),
        ("strain 0\n", "", "must follow a line 'strain'"),
        ("strain 0\nfrom 0\n", "strain 0\n", "must follow a line 'from'"),
        ("strain 0\n", "strain 5\n", "must ascend from 0"),
        ("strain 100000", "strain 0", "must ascend from 0"),
        ("strain 100000", "strain 600000", "must be at most"),
        ("board 00ff", "board 00ff\ncolour red", "not a line"),
        ("board 00ff", "board", "not a line"),
        ("board 00ff", "board 00ff\nboard 00ff", "twice"),
        ("plan F3", "plan F4", "six different"),
        ("plan F3", "plan F9", "six different"),
    ],
)
def test_a_bad_line_is_named(old, new, says):
    assert changed(old, new) != GOOD
    with pytest.raises(CalibrationError, match=says):
        Calibration(changed(old, new))


def test_every_accepted_number_is_a_small_int(calibration):
    def check(value):
        if isinstance(value, int):
            SmallInt(value)
        elif isinstance(value, (tuple, list, array)):
            for part in value:
                check(part)

    made = Calibration(calibration)
    for owner in (made, *segments_of(made)):
        check(list(vars(owner).values()))


@pytest.mark.parametrize(
    ("board", "plan", "gain", "exposure_us", "led_mA", "says"),
    [
        ("11", GOOD[1], 9, 10000, 20, "board"),
        ("00ff", "plan F2 F4 F5 F6 F7 F8", 9, 10000, 20, "channels=F3"),
        ("00ff", GOOD[1], 8, 10000, 20, "gain=9"),
        ("00ff", GOOD[1], 9, 10000, 30, "led_mA=20"),
    ],
)
def test_a_mismatch_says_what_to_do(board, plan, gain, exposure_us, led_mA, says):
    made = Calibration(GOOD)
    assert says in made.mismatch(
        Conditions(board, tuple(plan.split()[1:]), gain, exposure_us, led_mA)
    )


def test_a_match_says_nothing():
    assert (
        Calibration(GOOD).mismatch(Conditions("00ff", tuple(GOOD[1].split()[1:]), 9, 10000, 20))
        is None
    )


def test_another_exposure_is_no_mismatch_but_another_gain_is():
    made = Calibration(GOOD)
    plan = tuple(GOOD[1].split()[1:])
    assert made.mismatch(Conditions("00ff", plan, 9, 8333, 20)) is None
    assert "gain=9" in made.mismatch(Conditions("00ff", plan, 8, 8333, 20))
