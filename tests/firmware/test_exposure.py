"""Exposures that the registers allow, and the search of gain and LED current."""

import pytest
from hypothesis import example, given
from hypothesis import strategies as st

from spots_device.sensor import exposure
from spots_device.sensor.search import Search

STEP_US = 2.78  # DS000504


@given(st.integers(exposure.MIN_US, exposure.MAX_US))
def test_the_registers_come_nearest_and_are_allowed(exposure_us):
    atime, astep = exposure.registers(exposure_us)
    assert 0 <= atime <= 255
    assert 1 <= astep <= 65_534
    exact = (atime + 1) * (astep + 1) * STEP_US
    assert abs(exact - exposure_us) <= (atime + 1) * STEP_US / 2 + 1
    assert abs(exposure.actual_us(atime, astep) - exact) <= 0.5 + 1e-6


@given(st.integers(exposure.MIN_US, exposure.MAX_US))
@example(546_562)  # is rounded up to more than three cycles allow
@example(910_937)
def test_the_nearest_exposure_is_its_own_nearest(exposure_us):
    actual_us = exposure.actual_us(*exposure.registers(exposure_us))
    assert exposure.actual_us(*exposure.registers(actual_us)) == actual_us


def test_ten_milliseconds_are_those_of_the_datasheet():
    assert exposure.full_scale(*exposure.registers(10_000)) == 3597


def test_no_current_is_not_the_largest_current():
    assert [exposure.led_code(mA) for mA in (0, 4, 6, 258)] == [0, 0, 1, 127]


class Strip:
    """Simulated light for the search of settings; the gain steps are not exact powers of two."""

    GAIN = (0.5, 1, 2, 4.1, 8, 16, 32, 64, 128, 253, 496)

    def __init__(self, counts_per_us):
        self.counts_per_us = counts_per_us

    def read(self, search):
        full_scale = exposure.full_scale(*exposure.registers(search.exposure_us))
        light = search.led_mA / (1 + search.led_mA / 400)
        ideal = self.counts_per_us * search.exposure_us * self.GAIN[search.gain] * light
        return min(round(ideal), full_scale), full_scale, ideal >= full_scale


LED_MAX_MA = 100


def search(strip, gain=9, led_mA=20, exposure_us=10_000):
    made = Search(gain, led_mA, exposure_us, LED_MAX_MA)
    for _ in range(40):
        outcome = made.step(*strip.read(made))
        if outcome != exposure.AGAIN:
            return outcome, made
    raise AssertionError("the search does not end")


@given(
    st.floats(-6.5, -0.5),
    st.integers(0, 10),
    st.integers(0, LED_MAX_MA),
    st.sampled_from([2780, 10_000, 100_000, 400_000]),
)
def test_the_brightest_channel_ends_at_60_to_90_percent(exponent, gain, led_mA, exposure_us):
    strip = Strip(10**exponent)
    outcome, made = search(strip, gain, led_mA, exposure_us)
    assert made.led_mA <= LED_MAX_MA
    assert exposure.actual_mA(made.led_mA) == made.led_mA
    peak, full_scale, saturated = strip.read(made)
    if outcome == exposure.DONE:
        assert not saturated
        assert 0.6 <= peak / full_scale <= 0.9
    elif outcome == exposure.TOO_DARK:
        assert (made.gain, made.led_mA) == (exposure.GAIN_MAX, LED_MAX_MA)
    else:
        assert (made.gain, made.led_mA) == (0, exposure.LED_MIN_MA)


@pytest.mark.parametrize("counts_per_us", [3e-6, 1e-5, 1e-4, 1e-3, 1e-2])
def test_light_that_can_be_fitted_is_fitted(counts_per_us):
    assert search(Strip(counts_per_us))[0] == exposure.DONE


def test_the_exposure_is_lengthened_only_when_gain_and_led_are_spent():
    for counts_per_us in (1e-5, 1e-4, 1e-3):
        outcome, made = search(Strip(counts_per_us), gain=3, led_mA=LED_MAX_MA)
        assert outcome == exposure.DONE
        assert made.exposure_us == 10_000 or (made.gain, made.led_mA) == (10, LED_MAX_MA)


@given(st.floats(-6.5, -0.5), st.integers(0, 10), st.sampled_from([2780, 10_000, 400_000]))
def test_light_that_cannot_be_set_is_fitted_by_gain_and_exposure(exponent, gain, exposure_us):
    class Fixed(Strip):
        def read(self, search):
            search.led_mA += 20
            seen = super().read(search)
            search.led_mA -= 20
            return seen

    strip = Fixed(10**exponent)
    made = Search(gain, 0, exposure_us, 0)
    outcome = exposure.AGAIN
    while outcome == exposure.AGAIN:
        outcome = made.step(*strip.read(made))
        assert made.led_mA == 0
    peak, full_scale, saturated = strip.read(made)
    if outcome == exposure.DONE:
        assert not saturated
        assert 0.42 <= peak / full_scale <= 0.9
    elif outcome == exposure.TOO_DARK:
        assert (made.gain, made.exposure_us) == (exposure.GAIN_MAX, exposure.MAX_US)
    else:
        assert made.gain == 0


def test_no_light_is_too_dark_and_all_light_too_bright():
    assert search(Strip(0))[0] == exposure.TOO_DARK
    assert search(Strip(100))[0] == exposure.TOO_BRIGHT


@pytest.mark.parametrize(
    ("exposure_us", "mains_hz", "becomes_us"),
    [
        (10_000, 0, 10_000),
        (10_000, 50, 10_000),
        (2780, 50, 10_000),
        (16_000, 50, 20_000),
        (10_000, 60, 8333),
        (15_000, 60, 16_667),
        (100_000, 60, 100_000),
        (1_000_000, 60, 1_000_000),
        (1_000_000, 50, 1_000_000),
    ],
)
def test_an_exposure_under_lamps_is_whole_half_periods_of_the_mains(
    exposure_us, mains_hz, becomes_us
):
    assert exposure.choose(exposure_us, mains_hz) == becomes_us
    assert exposure.choose(becomes_us, mains_hz) == becomes_us
