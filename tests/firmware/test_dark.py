"""The dark frame: a mean of dark windows, which restarts if the ambient light has changed."""

import random
from array import array

import pytest
from bench import canned
from support.smallint import SmallInt, small

from spots_device.reading.dark import _WINDOW_SAMPLES, _WINDOWS, Baseline
from spots_device.reading.dark import IDLE_US as IDLE_US_MIN
from spots_device.reading.dark import Dark as DarkOf
from spots_device.reading.decode import (
    AGE_US,
    AVERAGE_MAX,
    BEGUN_US,
    CHECK,
    DARK_SAMPLES,
    EVERY_US,
    FLOOR_SAMPLES,
    IDLE_MIN_US,
    IDLE_US,
    ODD_US,
    SHADE_US,
    STATE_SIZE,
    TOUCHED,
    TOUCHING,
    WANTED,
)

EXPOSURE_US = 10_000
FULL = 65_535


def Dark():
    return DarkOf(array("i", bytes(4 * STATE_SIZE)))


def window(dark, counts):
    """Take a dark window; return its number of samples.

    `counts` are the six counts of each sample, or a function that returns them for each sample.
    """
    dark.begin(EXPOSURE_US)
    samples = 1
    while not dark.add(counts() if callable(counts) else counts):
        samples += 1
    return samples


def mean(dark):
    return [total / DARK_SAMPLES for total in dark.sums()]


def noisy(rng, level, sigma=0.6):
    return lambda: array("i", [max(0, round(rng.gauss(level, sigma))) for _ in range(6)])


def test_a_pool_is_nearer_to_the_truth_than_a_window():
    rng = random.Random(1)
    errors = {1: [], _WINDOWS: []}
    for _ in range(40):
        dark = Dark()
        for windows in range(1, _WINDOWS + 1):
            window(dark, noisy(rng, 5.5))
            if windows in errors:
                errors[windows] += [abs(one - 5.5) for one in mean(dark)]
    assert sum(errors[_WINDOWS]) < 0.4 * sum(errors[1])


def test_a_full_pool_forgets_as_fast_as_the_mean_of_its_windows_would():
    dark = Dark()
    for _ in range(_WINDOWS):
        window(dark, [4] * 6)
    for _ in range(_WINDOWS):
        window(dark, [5] * 6)
    assert mean(dark) == pytest.approx([5 - (7 / 8) ** _WINDOWS] * 6, abs=0.01)


def test_a_full_pool_stays_as_near_to_the_truth():
    rng = random.Random(4)
    errors = {_WINDOWS: [], 5 * _WINDOWS: []}
    for _ in range(40):
        dark = Dark()
        for windows in range(1, 5 * _WINDOWS + 1):
            window(dark, noisy(rng, 5.5))
            if windows in errors:
                errors[windows] += [(one - 5.5) ** 2 for one in mean(dark)]
    assert sum(errors[5 * _WINDOWS]) < 1.5 * sum(errors[_WINDOWS])


@pytest.mark.parametrize(("before", "after"), [(5, 40), (40, 5), (0, 20_000), (FULL, 0)])
def test_a_window_that_does_not_fit_restarts_the_pool(before, after):
    dark = Dark()
    for _ in range(5):
        window(dark, [before] * 6)
    window(dark, [before] * 5 + [after])
    assert mean(dark) == [before] * 5 + [after]


def test_noise_is_no_jump():
    rng = random.Random(2)
    for level in (0.5, 5.0, 300.0):
        dark = Dark()
        restarts = 0
        for _ in range(200):
            before = dark.count
            window(dark, noisy(rng, level, sigma=0.4 + 0.2 * level**0.5))
            restarts += dark.count < before
        assert restarts < 10, level


def test_a_faint_lamp_that_every_channel_sees_is_a_jump():
    rng = random.Random(3)
    dark = Dark()
    for _ in range(_WINDOWS):
        window(dark, noisy(rng, 0.1, sigma=0.3))
    window(dark, noisy(rng, 1.8, sigma=1.0))
    assert min(mean(dark)) > 0.5


def test_a_requested_pool_is_full_and_new():
    dark = Dark()
    window(dark, [5] * 6)
    window(dark, [6] * 6)
    dark.request_pool()
    assert window(dark, [7] * 6) == _WINDOWS * _WINDOW_SAMPLES == DARK_SAMPLES
    assert mean(dark) == [7] * 6


def test_a_requested_pool_takes_no_more_than_two_seconds_or_a_window():
    dark = Dark()
    for exposure_us, samples in ((100_000, 20), (1_000_000, 4)):
        dark.request_pool()
        dark.begin(exposure_us)
        taken = 1
        while not dark.add([5] * 6):
            taken += 1
        assert taken == samples


def test_single_samples_have_the_weight_of_a_quarter_of_a_window():
    dark = Dark()
    window(dark, [5] * 6)
    dark.schedule(EXPOSURE_US, 50)
    assert dark.state[EVERY_US] == 50 * EXPOSURE_US
    for taken in range(1, 5):
        assert window(dark, [6] * 6) == 1
        assert mean(dark) == pytest.approx([5 + taken / (4 + taken)] * 6, abs=0.02)


def test_a_change_is_taken_at_once_and_makes_dark_samples_frequent():
    dark = Dark()
    dark.schedule(EXPOSURE_US, 0)
    for _ in range(_WINDOWS):
        window(dark, [50] * 6)
    assert (dark.changing, dark.state[IDLE_MIN_US]) == (0, IDLE_US_MIN)
    window(dark, [30] * 6)
    assert mean(dark) == [30] * 6
    assert dark.changing
    assert (dark.state[EVERY_US], dark.state[IDLE_MIN_US]) == (20 * EXPOSURE_US, 0)
    assert window(dark, [50] * 6) == 1
    assert mean(dark) == [50] * 6
    samples = 0
    while dark.changing:
        assert window(dark, [50] * 6) == 1
        samples += 1
    assert samples == 80
    assert (dark.state[EVERY_US], dark.state[IDLE_MIN_US]) == (10_000_000, IDLE_US_MIN)


def test_while_the_light_changes_the_mean_forgets_fast():
    dark = Dark()
    window(dark, [50] * 6)
    window(dark, [90] * 6)
    for _ in range(20):
        window(dark, [90] * 6)
    for _ in range(12):
        window(dark, [92] * 6)  # less than what a single sample shows
    assert mean(dark) == pytest.approx([92] * 6, abs=0.5)


def test_a_flickering_lamp_is_no_change():
    dark = Dark()
    window(dark, [50] * 6)
    levels = iter((90, 10, 85, 15))
    window(dark, lambda: [next(levels)] * 6)
    levels = iter((20, 30, 60, 25))
    window(dark, lambda: [next(levels)] * 6)
    assert not dark.changing


def test_light_that_is_not_explained_needs_a_dark_sample():
    dark = Dark()
    dark.schedule(EXPOSURE_US, 0)
    for age, odd_us, touching, due in (
        (4, 10_000, 0, True),
        (3, 10_000, 0, False),
        (9, 0, 0, False),
        (7, 10_000, TOUCHING, False),
        (8, 10_000, TOUCHING, True),
    ):
        dark.state[AGE_US], dark.state[ODD_US] = age * EXPOSURE_US, odd_us
        dark.state[TOUCHED] = touching
        assert dark.is_due() is due


@pytest.mark.parametrize("light", [1, 4, 50])
def test_the_shadow_of_the_hand_that_presses_is_found_by_one_sample_of_a_touch(light):
    # As faint as it matters: half of a light of 4 counts in each channel moves positions by 0.3 mm.
    dark = Dark()
    dark.schedule(EXPOSURE_US, 0)
    for _ in range(_WINDOWS):
        window(dark, [light] * 6)
    assert (dark.state[SHADE_US] == 2_000_000) is (light > 1)
    dark.state[TOUCHED], dark.state[BEGUN_US] = TOUCHING, 200_000
    assert window(dark, [light] * 6) == 1
    assert not dark.changing
    if light > 1:
        assert window(dark, [light // 2] * 6) == 1 + _WINDOW_SAMPLES
        assert mean(dark) == [light // 2] * 6
        assert dark.changing
        dark.state[AGE_US] = 210_000  # older than the touch: the next finger may be of a hand, too
        assert dark.is_due()


@pytest.mark.parametrize("dark_every", [0, 50])
def test_a_check_is_one_window_and_keeps_the_mean(dark_every):
    dark = Dark()
    window(dark, [5] * 6)
    dark.schedule(EXPOSURE_US, dark_every)
    if dark_every:
        window(dark, [5] * 6)  # a single dark sample, which the next window must not include
    dark.state[WANTED] = CHECK
    assert window(dark, [6] * 6) == _WINDOW_SAMPLES
    assert mean(dark) == pytest.approx([5.5] * 6, abs=0.05)
    assert dark.state[WANTED] == 0


def test_the_largest_counts_fit_small_integers():
    dark = Dark()
    dark._window, dark.mean = small([0] * 6), small([0] * 6)
    for level in (FULL, FULL, 0, FULL):
        for _ in range(_WINDOWS + 1):
            window(dark, small([level] * 6))
    assert all(isinstance(one, SmallInt) for one in dark.mean)
    baseline = Baseline(dark)
    for samples in (1, 2, 3, 4, 5, 63, AVERAGE_MAX):
        dark_samples = baseline.rescale(samples)
        assert 4 <= dark_samples <= DARK_SAMPLES
        assert dark_samples * samples <= 256
        assert list(baseline.floor) == [FULL * dark_samples] * 6


class Board:
    def __init__(self, *settings):
        self.board, self.bus, self.clock, self.port = canned.app()
        self.app = self.board.strips[0]
        self.app.settings.change(settings)
        self.app.strip.configure()

    def run(self, seconds):
        end = self.clock.ticks_add(self.clock.now, int(1e6 * seconds))
        blinks, lit = 0, True
        while self.clock.ticks_diff(end, self.clock.now) > 0:
            self.board.step()
            blinks += lit and not self.app.strip.sensor.led_on
            lit = self.app.strip.sensor.led_on
        return blinks


@pytest.fixture(autouse=True)
def store(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)


def test_a_pressed_strip_takes_single_dark_samples_if_told():
    for settings, least, most in (((), 0, 0), (("dark_every=50",), 20, 40)):
        board = Board(*settings)
        state = board.app.strip.decode.state
        state[IDLE_US] = 0
        blinks = 0
        for _ in range(40):
            state[IDLE_US] = state[ODD_US] = 0  # as during the touch of one finger
            blinks += board.run(0.5)
        assert least <= blinks <= most


def test_the_reading_is_scaled_to_the_average():
    board = Board()
    for average in (1, 4, 16, 64, 3):
        board.app.settings.values["average"] = average
        board.app.strip.configure()
        board.run(2.0)
        strip = board.app.strip
        samples = strip.decode.state[FLOOR_SAMPLES]
        assert samples * average <= 256
        mean = [one / samples for one in strip.baseline.floor]
        assert mean == pytest.approx([1, 0, 2, 1, 0, 1], abs=0.01)
