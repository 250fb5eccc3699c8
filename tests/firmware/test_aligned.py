"""Times of the samples of several strips: errors below 20 us, one second after the start.

The tests use a model of the loop of a board with several strips on a Pico, with the firmware's
choice of the next strip. The chips are ideal except for their oscillators.
`tests/board/test_two_strips.py` tests a whole board.
"""

import math
import random
from types import SimpleNamespace

import pytest
from support.smallint import WRAP, SmallClock, SmallInt

from spots_device.board.aligned import AlignedPacing, Turns

LATCH_US = 75  # START, two addresses and a register number at 400 kHz
LEVEL_US = 147  # transfer of one byte: level of the FIFO, or ASTATUS
READ_US = 124  # overhead of the transfer of samples
SAMPLE_US = 270  # part of this transfer for the bytes of a sample
# Processor time of a pass and of a sample of a pressed strip, see data/cpus.toml.
PASS_US = 465
TAKE_US = 1_120
FULL = 20  # samples in the FIFO
LIMIT_US = 20
SETTLED_US = 1_000_000


class Strip:
    """A chip that samples periodically, with a drift in ppm/s, and the board's `AlignedPacing`."""

    def __init__(self, now, nominal_us, percent, first_us, ppm_per_s=0):
        self.pacing = AlignedPacing(SmallClock)
        self.reconnect = SimpleNamespace(lost=False)
        self.pacing.start(SmallInt(int(now) % WRAP), nominal_us)
        self.period_us = nominal_us * (1 + percent / 100)
        self.drift = ppm_per_s * 1e-12
        self.end = self.began = now + first_us + self.period_us
        self.waiting, self.read = [], []  # ends of samples in the FIFO, and in the board's buffer
        self.errors = []  # (time, error) of each sample, in us
        self.early = self.lost = 0

    def sample(self, now):
        while self.end <= now:
            self.waiting.append(self.end)
            self.end += self.period_us * (1 + self.drift * (self.end - self.began))


class Loop:
    """The loop of a board with several strips, with the processor time of a Pico."""

    def __init__(self, strips, seed=0, now=WRAP - 700_000.0):
        self.strips, self.now, self.random = strips(now), now, random.Random(seed)
        self.turns = Turns(self.strips, SmallClock)

    def run(self, duration_us):
        until = self.now + duration_us
        while self.now < until:
            strip = self.turns.next(SmallInt(int(self.now) % WRAP))
            left_us = SmallClock.ticks_diff(strip.pacing.due, int(self.now) % WRAP)
            self.now += min(max(0, left_us), 10_000)
            if left_us <= 10_000:
                self.poll(strip)
            self.now += PASS_US

    def poll(self, strip):
        if not strip.read:
            self.asked = SmallInt(int(self.now) % WRAP)
            strip.sample(self.now + LATCH_US)
            self.now += LEVEL_US
            self.known = SmallInt(int(self.now) % WRAP)
            waits = len(strip.waiting)
            if not waits or waits > FULL:
                self.now += LEVEL_US
                strip.waiting = []
                strip.lost += waits
                strip.early += not waits
                (strip.pacing.overrun if waits else strip.pacing.early)(self.asked)
                return
            self.now += READ_US + SAMPLE_US * waits
            strip.read, strip.waiting = strip.waiting, []
        waits = len(strip.read)
        end = strip.pacing.held(self.asked, self.known, SmallInt(waits))
        true = strip.read.pop(0)
        error_us = int(SmallClock.ticks_diff(end, int(true) % WRAP)) - true % 1
        strip.errors.append((self.now, error_us))
        self.now += TAKE_US


def two_strips(exposures_us, oscillators_percent, seed, drifts=(0, 0)):
    """Return a `Loop` with strips whose samples end at random times."""
    rng = random.Random(seed)

    def strips(now):
        each = zip(exposures_us, oscillators_percent, drifts)
        return [
            Strip(now, us, percent, 15_000 + us * rng.random(), ppm) for us, percent, ppm in each
        ]

    return Loop(strips, seed)


def settled(strip, from_us=SETTLED_US):
    return [error for at, error in strip.errors if at - strip.began >= from_us]


@pytest.mark.parametrize("seed", range(2))
@pytest.mark.parametrize("stall_us", [0, 50_000])
@pytest.mark.parametrize("oscillators_percent", [(0, 0), (0.3, -1), (5, -5)])
@pytest.mark.parametrize("exposures_us", [(10_000, 10_000), (5_000, 5_000), (10_000, 5_000)])
def test_times_are_within_20_us_from_a_second_on(exposures_us, oscillators_percent, stall_us, seed):
    loop = two_strips(exposures_us, oscillators_percent, seed)
    loop.run(1_100_000)
    for _ in range(3):
        loop.now += stall_us
        loop.run(1_000_000)
    for strip in loop.strips:
        errors = settled(strip)
        assert len(errors) >= 2_900_000 // strip.period_us
        assert max(map(abs, errors)) <= LIMIT_US
        assert abs(sum(errors)) <= 5 * len(errors)
        assert strip.lost == 0
        assert strip.early < 0.2 * len(strip.errors)


@pytest.mark.parametrize("seed", range(2))
@pytest.mark.parametrize("exposure_us", [10_000, 5_000])
def test_a_drift_of_20_ppm_per_second_is_followed(exposure_us, seed):
    loop = two_strips((exposure_us,) * 2, (0.3, -1), seed, drifts=(20, -10))
    loop.run(10_000_000)
    for strip in loop.strips:
        assert max(map(abs, settled(strip))) <= LIMIT_US


@pytest.mark.parametrize("exposure_us", [10_000, 5_000])
def test_times_are_exact_half_a_second_after_the_fifo_overran(exposure_us):
    loop = two_strips((exposure_us,) * 2, (0.3, -1), 1)
    loop.run(1_500_000)
    loop.now += 400_000
    stalled = loop.now
    loop.run(2_000_000)
    for strip in loop.strips:
        assert strip.lost > 0
        errors = settled(strip, stalled - strip.began + 500_000)
        assert max(map(abs, errors)) <= LIMIT_US


@pytest.mark.parametrize("seed", range(3))
@pytest.mark.parametrize("share", [1.0003, 1.002, 1.01])
def test_times_are_exact_two_seconds_after_the_period_jumped(share, seed):
    loop = two_strips((10_000, 10_000), (0, 0), seed)
    loop.run(3_000_000)
    loop.strips[0].period_us *= share
    loop.strips[1].period_us /= share
    jumped = loop.now
    loop.run(4_000_000)
    for strip in loop.strips:
        errors = settled(strip, jumped - strip.began + 2_000_000)
        assert max(map(abs, errors)) <= LIMIT_US


@pytest.mark.board
@pytest.mark.parametrize("nominal_us", [2_780, 100_000, 1_000_000])
@pytest.mark.parametrize("percent", [-5, 5])
def test_other_exposures_stay_within_31_bits(nominal_us, percent):
    loop = Loop(lambda now: [Strip(now, nominal_us, percent, 15_000)])
    loop.run(1_000 * nominal_us)
    (strip,) = loop.strips
    assert len(strip.errors) == pytest.approx(1_000 / (1 + percent / 100), abs=16)
    assert max(map(abs, settled(strip, 500 * nominal_us))) <= max(LIMIT_US, nominal_us // 2_000)


@pytest.mark.board
@pytest.mark.parametrize("percent", [-3, 0.1, 3])
def test_the_period_is_measured_for_the_mains_frequency(percent):
    loop = two_strips((10_000, 10_000), (percent, 0), 3)
    strip = loop.strips[0]
    pacing = strip.pacing
    while not pacing.sampled:
        loop.run(100_000)
    assert loop.now - strip.began < 3e6
    for _ in range(80):
        loop.run(1_000_000)
        assert pacing.lasted_us <= pacing.sampled * strip.period_us <= pacing.longest_us
        assert pacing.longest_us - pacing.lasted_us < pacing.longest_us / 2_000


def test_without_a_fifo_the_times_are_known_as_well():
    pacing = AlignedPacing(SmallClock)
    now, true_us, taken, errors = 10_000, 10_100, 0, []
    first = now + 15_000
    pacing.start(SmallInt(now), 10_000)
    for step in range(400):
        now += max(0, int(SmallClock.ticks_diff(pacing.due, now))) + (200_000 if step == 200 else 0)
        done = math.floor((now + LATCH_US - first) / true_us)
        if done > taken:
            taken = done
            end = pacing.found(SmallInt(now), SmallInt(now + 460))
            if end is not None:
                errors.append(int(end) - (first + done * true_us))
        else:
            pacing.early(SmallInt(now))
        now += 460
    assert taken == len(errors) + pacing.missed
    assert pacing.missed >= 19
    assert max(map(abs, errors[100:140] + errors[-50:])) <= LIMIT_US
