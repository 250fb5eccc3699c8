"""A board shifts its tables between the temperatures of two re-zeros, as the host would."""

from types import SimpleNamespace

import numpy as np
import pytest
from support.refusals import refusal

from spots.calibrate.fit.shift import shifted
from spots_device.reading.calibration import Calibration
from spots_device.reading.calibration_lines import CalibrationError
from spots_device.reading.log2 import ONE
from spots_device.runtime.common import rp2_mC
from spots_sim.board.thermometer import read_u16

MARKS_UM = 8500, 42_500, 76_500
# Change of log2 of each channel from 10 to 30 degrees at the three marks.
SHIFTS = np.array(
    [
        [0.010, 0.004, 0.0, -0.003, -0.006, -0.004],
        [0.012, 0.005, 0.001, -0.004, -0.007, -0.006],
        [0.015, 0.005, 0.002, -0.004, -0.009, -0.008],
    ]
)


def lines_of(calibration, range_mC=(10_000, 10_000, 30_000), marks=3):
    """Return the calibration with the lines of its temperature."""
    rows = zip(MARKS_UM[:marks], np.rint(SHIFTS * ONE).astype(int).tolist())
    warm = [" ".join(map(str, ["warm", place_um, *row])) for place_um, row in rows]
    return [*calibration, " ".join(map(str, ["temperature", *range_mC])), *warm]


@pytest.mark.parametrize(
    ("celsius", "share"), [(10, 0.0), (15, 0.25), (30, 1.0), (-20, 0.0), (80, 1.0)]
)
def test_the_tables_are_those_that_a_host_would_upload(calibration, celsius, share):
    made = Calibration(lines_of(calibration))
    made.thermal.follow(80_000)  # an earlier shift leaves nothing behind
    made.thermal.follow(1000 * celsius)
    expected = Calibration(shifted(calibration, MARKS_UM, share * SHIFTS)).tables
    off = np.abs(np.array(made.tables) - np.array(expected))
    assert off.max() <= 2
    assert (np.array(made.tables) == np.array(Calibration(calibration).tables)).all() == (not share)


@pytest.mark.parametrize("marks", [1, 2])
def test_fewer_marks_shift_by_a_polynomial_of_lower_degree(calibration, marks):
    made = Calibration(lines_of(calibration, marks=marks))
    made.thermal.follow(30_000)
    expected = Calibration(shifted(calibration, MARKS_UM[:marks], SHIFTS[:marks])).tables
    assert np.abs(np.array(made.tables) - np.array(expected)).max() <= 2


def test_the_tables_belong_to_the_temperature_of_the_last_re_zero(calibration):
    made = Calibration(lines_of(calibration, (25_000, 10_000, 30_000)))
    assert made.tables == Calibration(calibration).tables
    made.thermal.follow(10_000)
    expected = Calibration(shifted(calibration, MARKS_UM, -0.75 * SHIFTS)).tables
    assert np.abs(np.array(made.tables) - np.array(expected)).max() <= 2


def test_the_force_does_not_change(calibration):
    made = Calibration(lines_of(calibration))
    made.thermal.follow(30_000)
    assert list(made.brightnesses) == list(Calibration(calibration).brightnesses)


@pytest.mark.parametrize(
    ("old", "new", "reason"),
    [
        ("temperature 10000 10000 30000", "temperature 9000 10000 30000", "low <= made <= high"),
        ("temperature 10000 10000 30000", "temperature 10000 10000 10000", "low <= made <= high"),
        ("warm 42500", "warm 8500", "1 to 3 lines"),
        (f"warm 8500 {round(0.01 * ONE)}", "warm 8500 9000000", "too large"),
        ("-4194\nwarm 42500", "900000\nwarm 42500", "the knots of 'x'"),
        ("temperature 10000 10000 30000", "temperature 10000 30000", "needs 3 integers"),
    ],
)
def test_invalid_lines_are_refused(calibration, old, new, reason):
    text = "\n".join(lines_of(calibration))
    assert old in text
    with pytest.raises(CalibrationError, match=reason):
        Calibration(text.replace(old, new).split("\n"))


def test_lines_without_marks_are_refused(calibration):
    with refusal(CalibrationError):
        Calibration(lines_of(calibration, marks=0))


@pytest.mark.parametrize("celsius", [-20.0, 0.0, 25.0, 27.0, 60.0])
def test_a_pico_measures_its_temperature_to_half_a_step(celsius):
    chip = SimpleNamespace(temperature_C=lambda now_us: celsius)
    bus = SimpleNamespace(chip=chip, clock=SimpleNamespace(now_us=lambda: 0.0))
    assert rp2_mC(lambda: read_u16(bus)) == pytest.approx(1000 * celsius, abs=260)
