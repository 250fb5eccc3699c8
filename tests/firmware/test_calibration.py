"""A calibration is believed only when every line of it makes sense."""

import pytest
from smallint import SmallInt

from tactile.calibration import Calibration, CalibrationError

GOOD = [
    "",
    "board 00ff",
    "plan F3 F4 F5 F6 F7 F8",
    "made 9 10000 20",
    "touch 300 200",
    "position -4096 -4096 0 0 4096 4096",
    "force 0 0 0 0 0 8192",
    "fit 8192 -8192 0 0 0 0",
    "x 0 0 5",
    "x 100000 8000 5",
    "f 1000 200 9000",
    "f 100000 6000 90",
    "",
]


def changed(old, new):
    return [line.replace(old, new) for line in GOOD]


def test_the_real_one_is_good(calibration):
    made = Calibration(calibration)
    assert made.plan == ("F3", "F4", "F5", "F6", "F7", "F8")
    assert (made.positions_um[0], made.positions_um[-1]) == (0, 85_000)


def test_the_order_of_the_statements_does_not_matter():
    knots = [line for line in GOOD if line[:2] in ("x ", "f ")]
    others = [line for line in GOOD if line not in knots]
    assert vars(Calibration(knots + others[::-1])) == vars(Calibration(GOOD))


@pytest.mark.parametrize(
    ("old", "new", "says"),
    [
        ("fit 8192 -8192 0 0 0 0", "", "missing"),
        ("touch 300 200", "touch 200 300", "begin"),
        ("touch 300 200", "touch 300 0", "begin"),
        ("touch 300 200", "touch 300", "2 integers"),
        ("touch 300 200", "touch 300 many", "2 integers"),
        ("made 9 10000 20", "made 9 10000 20\nx", "3 integers"),
        ("position -4096", "position -4095", "add up to 0"),
        ("force 0 0 0 0 0 8192", "force 0 0 0 0 0 8193", "add up to 8192"),
        ("fit 8192 -8192", "fit 80000 -80000", "too large"),
        ("x 100000 8000 5", "x 0 8000 5", "ascend"),
        ("x 100000 8000 5", "x 100000 0 5", "monotone"),
        ("x 100000 8000 5", "x 1000000 8000 5", "too far apart"),
        ("x 100000 8000 5", "x 1073741824 8000 5", "31 bits"),
        ("x 100000 8000 5", "", "2 to 128"),
        ("board 00ff", "board 00ff\ncolour red", "no line"),
        ("board 00ff", "board", "no line"),
        ("plan F3", "plan F4", "six different"),
        ("plan F3", "plan F9", "six different"),
    ],
)
def test_a_bad_line_is_named(old, new, says):
    with pytest.raises(CalibrationError, match=says):
        Calibration("\n".join(changed(old, new)).split("\n"))


def test_twice_is_once_too_often():
    with pytest.raises(CalibrationError, match="twice"):
        Calibration([*GOOD, "touch 300 200"])


def test_every_accepted_number_is_a_small_int(calibration):
    made = Calibration(calibration)
    for value in vars(made).values():
        for number in value if isinstance(value, tuple) else (value,):
            if isinstance(number, int):
                SmallInt(number)


@pytest.mark.parametrize(
    ("board", "plan", "gain", "exposure_us", "led_mA", "says"),
    [
        ("11", GOOD[2], 9, 10000, 20, "board"),
        ("00ff", "plan F2 F4 F5 F6 F7 F8", 9, 10000, 20, "channels"),
        ("00ff", GOOD[2], 8, 10000, 20, "gain=9"),
        ("00ff", GOOD[2], 9, 20000, 20, "exposure_us=10000"),
        ("00ff", GOOD[2], 9, 10000, 30, "led_mA=20"),
    ],
)
def test_a_mismatch_says_what_to_do(board, plan, gain, exposure_us, led_mA, says):
    made = Calibration(GOOD)
    assert says in made.mismatch(board, plan.split()[1:], gain, exposure_us, led_mA)


def test_a_match_says_nothing():
    assert Calibration(GOOD).mismatch("00ff", GOOD[2].split()[1:], 9, 10000, 20) is None
