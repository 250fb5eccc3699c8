"""The lock on the sensor's clock: no sample missed, none twice, hardly a poll in vain."""

import random

import pytest
from smallint import SmallInt

from tactile.pacing import Pacing

WRAP = 1 << 30
BURST_US = 390
CLEAR_US = 73


class Clock:
    @staticmethod
    def ticks_add(ticks, delta):
        return SmallInt((int(ticks) + int(delta)) % WRAP)

    @staticmethod
    def ticks_diff(end, start):
        return SmallInt((int(end) - int(start) + WRAP // 2) % WRAP - WRAP // 2)


class Run:
    """A sensor that samples every `true_us`, polled when `Pacing` says so."""

    def __init__(self, nominal_us, true_us, started_us=WRAP - 50_000, first_us=15_000):
        self.pacing = Pacing(Clock)
        self.now = started_us
        self.true_us = true_us
        self.origin = self.now + first_us
        self.taken = 0  # index of the sample read last, as the sensor counts
        self.polls = 0
        self.samples = []  # (index, error of its stamp in us)
        self.pacing.start(SmallInt(self.now % WRAP), nominal_us)

    def poll(self, late_us=0):
        wait_us = Clock.ticks_diff(self.pacing.due, self.now % WRAP)
        self.now += max(0, int(wait_us)) + late_us
        before = self.now
        done = int((self.now - self.origin) // self.true_us)
        self.now += BURST_US
        self.polls += 1
        if done <= self.taken:
            self.pacing.early(SmallInt(before % WRAP))
            return
        self.taken = done
        self.now += CLEAR_US
        stamp = self.pacing.found(SmallInt(before % WRAP), SmallInt(self.now % WRAP))
        if stamp is not None:
            true = (self.origin + done * self.true_us) % WRAP
            self.samples.append((done, int(Clock.ticks_diff(stamp, round(true) % WRAP))))


@pytest.mark.parametrize("nominal_us", [2780, 10_000, 100_000, 1_000_000])
@pytest.mark.parametrize("error_percent", [-5, -1, 0, 1, 5])
def test_every_sample_is_read_once(nominal_us, error_percent):
    run = Run(nominal_us, nominal_us * (1 + error_percent / 100))
    while len(run.samples) < 600:
        run.poll()
    indices = [index for index, _ in run.samples]
    assert indices == list(range(1, len(indices) + 1))
    assert run.pacing.missed == 0


@pytest.mark.parametrize("error_percent", [-5, 0, 5])
def test_one_burst_finds_one_sample_once_locked(error_percent):
    run = Run(10_000, 10_000 * (1 + error_percent / 100))
    while len(run.samples) < 300:
        run.poll()
    before, samples = run.polls, len(run.samples)
    while len(run.samples) < 2300:
        run.poll()
    assert (run.polls - before) / (len(run.samples) - samples) < 1.15


@pytest.mark.parametrize("error_percent", [-5, 0, 5])
def test_stamps_lie_within_a_retry_of_the_truth(error_percent):
    run = Run(10_000, 10_000 * (1 + error_percent / 100))
    while len(run.samples) < 2000:
        run.poll()
    assert all(-1 <= error <= 1000 for _, error in run.samples)


def test_a_stall_loses_samples_but_never_misdates_one():
    rng = random.Random(1)
    run = Run(10_000, 10_100)
    for _ in range(20_000):
        run.poll(late_us=rng.choice([0] * 50 + [500, 2_000, 9_000, 15_000, 200_000]))
    indices = [index for index, _ in run.samples]
    assert len(set(indices)) == len(indices)
    assert all(-200 <= error <= 2000 for _, error in run.samples)
    assert run.pacing.missed >= indices[-1] - len(indices)


def test_a_drifting_oscillator_is_followed():
    run = Run(10_000, 10_000)
    for step in range(20_000):
        if step % 100 == 0:  # a warming chip: 0.5 % over the run, without a jump in phase
            true_us = 10_000 - step / 400
            run.origin += run.taken * (run.true_us - true_us)
            run.true_us = true_us
        run.poll()
    assert run.pacing.missed == 0
    assert [index for index, _ in run.samples] == list(range(1, len(run.samples) + 1))
