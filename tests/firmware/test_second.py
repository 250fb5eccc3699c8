"""The estimated position of a second finger beside a resting first finger."""

import math

import pytest
from smallint import SmallInt

from keys import DECAY
from spots_device.calibration import Calibration
from spots_device.decode import DARK_SUBTRACTED, MISFIT, Decode
from spots_device.second import locate, power
from spots_sim.optics import Optics


@pytest.fixture(scope="module")
def feel(sensor, calibration):
    """Return a function from fingers (place in mm, share of full contact) to what the board has."""
    calibration = Calibration(calibration)
    optics, made = Optics(sensor), calibration.conditions
    columns = [optics.names.index(diode) for diode in made.plan]
    scale = optics.source_uW_cm2(made.led_mA) * made.exposure_us / 1000 * 2.0 ** (made.gain - 1)
    decode = Decode()
    decode.calibration = calibration

    def run(*fingers):
        rates = sum(share * optics.press(x_mm, 4.0)[columns] for x_mm, share in fingers)
        # Sums over 64 samples: no noise, hardly any rounding.
        decode.update([round(64 * scale * rate) for rate in rates], 64, [0] * 6, DARK_SUBTRACTED)
        return decode.position_um, decode.brightness, not decode.flags & MISFIT

    return run


@pytest.mark.parametrize("exponent", [-9.3, -1.0, -0.2, 0.0, 0.37, 0.75, 5.5, 16.99])
def test_a_power_of_two(exponent):
    value = power(round(exponent * (1 << 20)))
    assert value == pytest.approx(1024 * 2**exponent, rel=0.004, abs=1)


@pytest.mark.parametrize("first_mm", [8.0, 42.0, 77.0])
@pytest.mark.parametrize("ratio", [0.5, 1.0, 2.0])
def test_the_second_finger_is_found_within_a_part_of_a_key(feel, first_mm, ratio):
    found = [0] * 3
    x1_um, b1, _ = feel((first_mm, 0.2))
    for second_mm in (4.0, 25.0, 60.0, 81.0):
        if abs(second_mm - first_mm) < 15:
            continue
        x_um, b, fits = feel((first_mm, 0.2), (second_mm, 0.2 * ratio))
        numbers = (SmallInt(n) for n in (DECAY, x1_um, b1, x_um, b, fits, 60))
        assert locate(found, *numbers)
        off_mm = abs(found[0] / 1000 - second_mm)
        assert off_mm < 1.6
        assert off_mm < 2 * found[1] / 1000
        _, alone, _ = feel((second_mm, 0.2 * ratio))
        assert found[2] / (1 << 20) == pytest.approx(alone / (1 << 20), abs=0.1)


def test_a_finger_that_presses_harder_is_no_second_one(feel):
    x1_um, b1, _ = feel((40.0, 0.2))
    for share in (0.15, 0.21, 0.4):
        x_um, b, fits = feel((40.2, share))
        assert not locate([0] * 3, DECAY, x1_um, b1, x_um, b, fits, 60)


def test_what_lies_out_of_reach_is_no_second_finger():
    bright = 9 * (1 << 20)
    for x_um in (-(1 << 28), -300_000, 300_000, 1 << 28):
        for b in (0, bright, math.floor(17.5 * (1 << 20))):
            for decay in (DECAY, 1000):
                numbers = (SmallInt(n) for n in (decay, 0, bright, x_um, b, True, 20_000))
                assert not locate([0] * 3, *numbers)


@pytest.mark.parametrize("x_mm", [-240, -80, 3, 80, 240])
@pytest.mark.parametrize("decay", [1, 150, 600, 1000])
def test_no_dye_exceeds_the_integers_of_a_board(x_mm, decay):
    for bright in range(6, 13):
        for fits in (False, True):
            reading = (1000 * x_mm, bright << 20, fits, 20_000)
            locate(
                [0] * 3, SmallInt(decay), SmallInt(0), SmallInt(6 << 20), *map(SmallInt, reading)
            )
