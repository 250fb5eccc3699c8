"""The baseline follows the lit samples beside a dark window, but no finger and no ambient light."""

import random
from array import array
from types import SimpleNamespace

import pytest
from support.smallint import small

from spots_device.reading import decode as d
from spots_device.reading.dark import Baseline, Dark
from spots_device.reading.decode import DARK_SAMPLES, Decode

COUNTS = (8.0, 9.0, 12.0, 17.0, 26.0, 15.0)  # light of dust, in counts of a sample
FULL = 65_535


class Windows:
    """An untouched strip, of which the board takes dark windows.

    Parameters
    ----------
    baseline : sequence of float
        Baseline of the calibration, in counts.
    """

    def __init__(self, baseline=()):
        self.state = Decode().state
        self.state[d.SAMPLES], self.state[d.IDLE_US] = 1, d.IDLE_US_MAX
        self.state[d.FLAGS] = 0
        self.dark = Dark(self.state)
        self.dark.schedule(10_000, 0)
        self.baseline = Baseline(self.dark)
        self.baseline.rescale(1)
        self.start([round(DARK_SAMPLES * one) for one in baseline], 1.0)
        self.rng = random.Random(1)

    def start(self, baseline, ratio):
        made = SimpleNamespace(baseline=baseline, conditions=SimpleNamespace(exposure_us=10_000))
        self.baseline.start(made, round(10_000 * ratio))

    def sample(self, light, ambient):
        noise = [self.rng.gauss(0.0, 0.35) for _ in range(6)]
        return [min(max(round(a + b + c + 0.4), 0), FULL) for a, b, c in zip(light, ambient, noise)]

    def take(self, light=(0.0,) * 6, ambient=(0.0,) * 6, later=None, flags=0):
        """Take a dark window; `later` is the ambient light after the window, if it has changed."""
        for i, one in enumerate(self.sample(light, ambient)):
            self.state[d.SUMS + i] = one
        self.baseline.before()
        self.state[d.WANTED] = d.CHECK  # else single samples, while the ambient light changes
        assert self.dark.begin(10_000)
        while not self.dark.add(self.sample((0.0,) * 6, ambient)):
            pass
        self.baseline.update()
        self.state[d.FLAGS] = flags
        while self.baseline.left:
            self.baseline.after(self.sample(light, later or ambient), True)
        self.state[d.FLAGS] = 0

    @property
    def counts(self):
        return [one / DARK_SAMPLES for one in self.baseline.sums()]


def test_a_strip_without_light_gets_no_baseline():
    made = Windows()
    for _ in range(8 * 360):  # a window every 10 s for 8 hours
        made.take()
    assert made.counts == [0.0] * 6


def test_growing_light_is_followed():
    made = Windows()
    for size in (1, 2, 3, 4):
        made.take([size * one for one in COUNTS])
        assert made.counts == pytest.approx([size * one for one in COUNTS], abs=1.0)


def test_fading_light_is_followed_at_once():
    made = Windows(COUNTS)
    assert made.counts == pytest.approx(COUNTS, abs=0.01)
    made.take()
    assert made.counts == pytest.approx([0.0] * 6, abs=1.0)


def test_faint_light_is_found_by_many_windows():
    made = Windows()
    for _ in range(60):
        made.take([0.06 * one for one in COUNTS])
    assert made.counts == pytest.approx([0.06 * one for one in COUNTS], abs=0.5)
    assert sum(made.counts) > 2.0


@pytest.mark.parametrize("shaded", [(0.0,) * 6, (30.0,) * 6])
def test_ambient_light_and_its_shadow_never_enter(shaded):
    made = Windows(COUNTS)
    lamp = (120.0, 130.0, 80.0, 80.0, 120.0, 160.0)
    for _ in range(20):
        made.take(COUNTS, lamp)
        made.take(COUNTS, shaded)
    assert made.counts == pytest.approx(COUNTS, abs=1.0)


def test_a_shadow_in_the_window_is_ignored():
    made = Windows(COUNTS)
    for _ in range(10):
        made.take(COUNTS, (60.0,) * 6, later=(20.0,) * 6)
        made.take(COUNTS, (20.0,) * 6, later=(60.0,) * 6)
    assert made.counts == pytest.approx(COUNTS, abs=0.01)


@pytest.mark.parametrize("flags", [d.TOUCHING, d.TOUCHING | d.MISFIT, d.SATURATED])
def test_a_touch_never_enters(flags):
    made = Windows(COUNTS)
    for _ in range(10):
        made.take([300.0] * 6, flags=flags)
    assert made.counts == pytest.approx(COUNTS, abs=0.01)
    for reason in ((d.IDLE_US, 0), (d.AGE_STEP_US, 0), (d.TAKEN, 1), (d.FLAGS, d.NOT_CALIBRATED)):
        other = Windows(COUNTS)
        other.state[reason[0]] = reason[1]
        other.baseline.before()
        assert other.baseline.left == 0, reason


def test_the_present_light_is_taken_on_request():
    made = Windows()
    for i in range(6):
        made.state[d.SUMS + i] = 100
    made.baseline.take()
    assert made.counts == [100.0] * 6


def test_another_exposure_scales_the_baseline():
    made = Windows()
    made.start([640, 64, 0, 32, 1, 65_535 * 64], 10.0)
    assert made.counts == [100.0, 10.0, 0.0, 5.0, 10 / 64, FULL]
    assert list(made.baseline.floor)[:2] == [100 * 64, 10 * 64]


def test_the_largest_counts_fit_small_integers():
    made = Windows()
    base = made.baseline
    base._before, base._after, base._gap = (small([0] * 6) for _ in range(3))
    made.dark.window, made.dark.mean, base._level = (small([0] * 6) for _ in range(3))
    full = array("i", [FULL] * 6)
    for dark, lit in ((full, full), (array("i", [0] * 6), full), (full, [0] * 6), (full, full)):
        for _ in range(20):
            for i in range(6):
                base._before[i] = 4 * lit[i]
                base._after[i] = 4 * lit[i]
                made.dark.window[i] = 4 * dark[i]
            assert base._is_steady()
            base._follow_gap()
    for i in range(6):
        base._before[i], base._after[i] = 0, 4 * FULL
    assert not base._is_steady()
