"""The estimated position of a second finger beside a resting first finger."""

import math

import numpy as np
import pytest
from support.smallint import SmallInt

from spots.calibrate.fit.decoded import Decoded
from spots_device.fingers import locate as locate_module
from spots_device.fingers import state as contact_state
from spots_device.fingers.locate import locate, power
from spots_device.fingers.second import may_be_still, weigh
from spots_device.reading.calibration import Calibration
from spots_device.reading.decode import DARK_SUBTRACTED, MISFIT
from spots_sim.strip.optics import Optics

DECAY = 286  # attribute `Calibration.decay` of the default strip


@pytest.fixture(autouse=True)
def _small(monkeypatch):
    """Let `solve` store its results in a list, because an array would convert `SmallInt` to int."""
    monkeypatch.setattr(locate_module, "_solved", [0] * 4)


@pytest.fixture(scope="module")
def feel(sensor, calibration):
    """Return a function that computes a reading of fingers, and returns it.

    A finger is (position in mm, share of full contact). Without the random generator `noise`, the
    reading has no noise and very little rounding.
    """
    calibration = Calibration(calibration)
    assert calibration.decay == DECAY
    optics, made = Optics(sensor), calibration.conditions
    columns = [optics.names.index(diode) for diode in made.plan]
    scale = optics.source_uW_cm2(made.led_mA) * made.exposure_us / 1000 * 2.0 ** (made.gain - 1)
    decode = Decoded()
    decode.calibration = calibration

    converter = sensor.converter
    electrons = converter.electrons_per_count_1x / 2.0 ** (made.gain - 1)

    def run(*fingers, noise=None):
        rates = sum(share * optics.press(x_mm, 4.0)[columns] for x_mm, share in fingers)
        counts = scale * np.array(rates)
        samples = 64 if noise is None else 1
        if noise is not None:
            variance = converter.read_noise_counts**2 + counts / electrons
            counts += noise.normal(0, np.sqrt(variance))
        decode.update(
            [round(samples * count) for count in counts], samples, [0] * 6, DARK_SUBTRACTED
        )
        return decode.position_um, decode.brightness, not decode.flags & MISFIT

    return run


def two_readings(x1_um, b1, some, more, decay=DECAY, length_um=85_000):
    """Return the state of a tracker with a finger and two readings (position, brightness)."""
    state = [SmallInt(0)] * contact_state.SIZE
    for at, value in (
        (contact_state.DECAY, decay),
        (contact_state.LENGTH_UM, length_um),
        (contact_state.X_UM, x1_um),
        (contact_state.B, b1),
        (contact_state.X_LAST_UM, some[0]),
        (contact_state.B_LAST, some[1]),
        (contact_state.X_NOW_UM, more[0]),
        (contact_state.B_NOW, more[1]),
    ):
        state[at] = SmallInt(value)
    return state


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


FIRM = 0.416  # share of full contact at 3 N
# Least possible standard deviation of the second finger's position in mm, by number of samples of
# 10 ms, if the light of the first finger is unknown.
BOUND_MM = {1: 1.8, 5: 0.8}


@pytest.mark.parametrize("places_mm", [(10, 27), (30, 47), (62, 45), (60, 80), (10, 80), (80, 10)])
def test_a_second_finger_is_as_certain_as_the_noise_allows(feel, places_mm):
    rng = np.random.default_rng(3)
    first_mm, second_mm = places_mm
    found, places = [0] * 3, []
    for _ in range(100):
        x1_um, b1, _ = feel((first_mm, FIRM), noise=rng)
        reading = feel((first_mm, FIRM), (second_mm, FIRM), noise=rng)
        assert locate(found, DECAY, x1_um, b1, *reading, 60)
        places.append(found[0] / 1000)
    for samples, bound_mm in BOUND_MM.items():
        means = np.reshape(places, (-1, samples)).mean(axis=1)
        assert np.std(means) <= 1.2 * bound_mm
        assert np.sqrt(np.mean((means - second_mm) ** 2)) <= 1.2 * BOUND_MM[1]


@pytest.mark.parametrize("places_mm", [(10, 27), (30, 47), (62, 45), (60, 80), (10, 70), (80, 20)])
def test_two_readings_give_both_fingers_though_the_light_of_the_first_is_unknown(feel, places_mm):
    first_mm, second_mm = places_mm
    x1_um, alone, _ = feel((first_mm, FIRM))
    some = feel((first_mm, FIRM), (second_mm, 0.4 * FIRM))[:2]
    more = feel((first_mm, FIRM), (second_mm, FIRM))[:2]
    found = two_readings(x1_um, alone, some, more)
    assert weigh(found)
    off_mm = abs(found[0] / 1000 - second_mm)
    assert off_mm < 2
    assert off_mm < found[1] / 1000
    assert found[2] / (1 << 20) == pytest.approx(alone / (1 << 20), abs=0.06)


def test_readings_of_one_light_give_no_second_finger(feel):
    x1_um, _, _ = feel((30.0, FIRM))
    both = feel((30.0, FIRM), (60.0, FIRM))[:2]
    assert not weigh(two_readings(x1_um, 0, both, both))


@pytest.mark.parametrize("share", [0.2, 1.0])
def test_a_light_that_no_second_finger_leaves_shows_that_the_first_one_lifts(feel, share):
    x1_um, b1, _ = feel((30.0, FIRM))
    reading = feel((30.0, share * FIRM), (60.0, 0.3 * FIRM))[:2]
    assert may_be_still(two_readings(x1_um, b1, reading, reading)) == (share == 1)


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
            known = SmallInt(decay), SmallInt(0)
            locate([0] * 3, *known, SmallInt(6 << 20), *map(SmallInt, reading))
            for length_um in (30_000, 85_000, 600_000):
                again = (600 * x_mm, bright + 1 << 20)
                some = two_readings(0, 6 << 20, reading[:2], again, decay, length_um)
                weigh(some)
                may_be_still(some)
