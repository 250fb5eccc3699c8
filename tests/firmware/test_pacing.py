"""The schedule of polls: no sample is missed or read two times, and few polls are early."""

import random

import pytest
from support.smallint import WRAP, SmallClock, SmallInt

from spots_device.board.aligned import AlignedPacing
from spots_device.sensor.pacing import Pacing

BURST_US = 390
CLEAR_US = 73
LATCH_US = 75  # from the beginning of a poll to the moment at which the chip latches its data


class Run:
    """A simulated sensor that samples every `true_us`, and is polled at the times of `Pacing`."""

    def __init__(self, nominal_us, true_us, started_us=WRAP - 50_000, first_us=15_000):
        self.pacing = Pacing(SmallClock)
        self.now = started_us
        self.true_us = true_us
        self.origin = self.now + first_us
        self.taken = 0  # number of the last sample that was read, counted by the sensor
        self.polls = 0
        self.samples = []  # (number, error of its estimated time in us)
        self.slacks_us = []
        self.pacing.start(SmallInt(self.now % WRAP), nominal_us)

    def restart(self, nominal_us, true_us):
        """Restart the sensor with other periods in us: nominal, and true; same oscillator."""
        self.true_us, self.taken, self.samples = true_us, 0, []
        self.origin = self.now + 15_000
        self.learn()
        self.pacing.start(SmallInt(self.now % WRAP), nominal_us)

    def learn(self):
        """Update the oscillator's deviation as `Pacing.learn`, with integers of any size."""
        pacing = self.pacing
        pacing.lasted_us, pacing.longest_us = int(pacing.lasted_us), int(pacing.longest_us)
        pacing.learn()

    def poll(self, late_us=0):
        wait_us = SmallClock.ticks_diff(self.pacing.due, self.now % WRAP)
        self.now += max(0, int(wait_us)) + late_us
        before = self.now
        done = int((self.now + LATCH_US - self.origin) // self.true_us)
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
            error_us = int(SmallClock.ticks_diff(stamp, round(true) % WRAP))
            self.samples.append((done, error_us))
            self.slacks_us.append(int(self.pacing.slack_us))


@pytest.mark.parametrize("nominal_us", [2780, 10_000, 100_000, 1_000_000])
@pytest.mark.parametrize("error_percent", [-5, -1, 0, 1, 5])
def test_every_sample_is_read_once(nominal_us, error_percent):
    run = Run(nominal_us, nominal_us * (1 + error_percent / 100))
    while len(run.samples) < 600:
        run.poll()
        assert run.pacing.period_us > 0.9 * nominal_us  # no difference of ticks has wrapped
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


class FifoRun(Run):
    """A `Run` of a sensor with a FIFO, so that late polls lose nothing."""

    def __init__(self, *arguments):
        super().__init__(*arguments)
        self.sure = self.wrong = 0

    def poll(self, late_us=0):
        pacing = self.pacing
        self.now += max(0, int(SmallClock.ticks_diff(pacing.due, self.now % WRAP))) + late_us
        asked = SmallInt(self.now % WRAP)
        done = max(0, int((self.now + LATCH_US - self.origin) // self.true_us))
        waits = done - self.taken
        self.now += BURST_US
        self.polls += 1
        self.sure += pacing.sure_polls > 0
        if not waits:
            self.wrong += pacing.sure_polls > 0
            pacing.early(asked)
            return
        self.taken = done
        pacing.held(asked, SmallInt(self.now % WRAP), SmallInt(waits))
        if waits > 2:
            pacing.skip(SmallInt(waits - 2))
        if waits > 1:
            pacing.held(asked, SmallInt(self.now % WRAP), SmallInt(1))


@pytest.mark.board
@pytest.mark.parametrize("error_percent", [-5, 0, 5])
@pytest.mark.parametrize(("nominal_us", "share"), [(1_000, 0.3), (2_780, 0.7), (10_000, 0.5)])
def test_most_polls_are_sure_to_find_a_sample_and_do(error_percent, nominal_us, share):
    rng = random.Random(3)
    run = FifoRun(nominal_us, nominal_us * (1 + error_percent / 100))
    while run.polls < 20_000:
        late = rng.choice([0] * 97 + [0.05, 0.5, 4.5]) if run.polls > 500 else 0
        run.poll(late_us=round(late * nominal_us))  # a share of the period
        if run.polls == 1000:
            run.sure = 0
    assert not run.wrong
    assert run.sure / 19_000 > share


@pytest.mark.parametrize("error_percent", [-5, 0, 5])
@pytest.mark.parametrize("nominal_us", [2_780, 5_000, 10_000])
def test_times_are_exact_after_a_second(error_percent, nominal_us):
    run = Run(nominal_us, nominal_us * (1 + error_percent / 100))
    while len(run.samples) < 2000:
        run.poll()
    errors = [error for _, error in run.samples]
    assert max(map(abs, errors)) <= 1000
    assert max(map(abs, errors[1_000_000 // nominal_us :])) <= 20


def test_a_stall_loses_samples_but_never_misdates_one():
    rng = random.Random(1)
    run = Run(10_000, 10_100)
    for _ in range(20_000):
        run.poll(late_us=rng.choice([0] * 50 + [500, 2_000, 9_000, 15_000, 200_000]))
    indices = [index for index, _ in run.samples]
    assert len(set(indices)) == len(indices)
    # Two stalls in a row look like a slow loop, whose samples are used although they are uncertain.
    coarse = [slack > 2000 for slack in run.slacks_us]
    assert sum(coarse) < 0.15 * len(coarse)
    for (_, error), slack_us in zip(run.samples, run.slacks_us):
        assert -200 <= error <= max(2000, slack_us)
    assert run.pacing.missed >= indices[-1] - indices[0] + 1 - len(indices)


def test_a_drifting_oscillator_is_followed():
    run = Run(10_000, 10_000)
    for step in range(20_000):
        if step % 100 == 0:  # a warming chip: 0.5 % during the test, without a jump of the phase
            true_us = 10_000 - step / 400
            run.origin += run.taken * (run.true_us - true_us)
            run.true_us = true_us
        run.poll()
    assert run.pacing.missed == 0
    assert [index for index, _ in run.samples] == list(range(1, len(run.samples) + 1))


@pytest.mark.board
@pytest.mark.parametrize("nominal_us", [1_000, 1_500, 2_780, 10_000])
@pytest.mark.parametrize("passes", [0.3, 0.9, 1.05, 1.2, 1.5, 2.65, 7.3])
@pytest.mark.parametrize("error_percent", [-3, 0, 3])
@pytest.mark.parametrize("vain_us", [200, 3_000])
def test_a_loop_of_any_speed_reads_what_it_can_and_counts_the_rest(
    nominal_us, passes, error_percent, vain_us
):
    true_us = nominal_us * (1 + error_percent / 100)
    run = Run(nominal_us, true_us)
    used_us = max(BURST_US + CLEAR_US, round(passes * nominal_us))
    began_us = run.now
    while run.now - began_us < 2_000 * nominal_us:
        taken = run.taken
        run.poll()
        run.now += used_us - BURST_US - CLEAR_US if run.taken > taken else vain_us
    ended = run.samples[-1][0]
    # A loop that is almost too slow cannot avoid a few early polls.
    vain = (BURST_US + vain_us) / true_us if used_us < 2 * true_us else 0
    least = 1 / (max(1, used_us / true_us) + vain)
    assert len(run.samples) >= 0.9 * least * ended
    assert len({index for index, _ in run.samples}) == len(run.samples)
    assert len(run.samples) + run.pacing.missed == pytest.approx(ended, rel=0.04)


@pytest.mark.parametrize("nominal_us", [1_000, 1_500, 2_780])
@pytest.mark.parametrize("busy_us", [100, 900, 1_800, 2_700, 5_000])
@pytest.mark.parametrize("error_percent", [-5, -2, 2, 5])
def test_what_the_chip_made_was_taken_or_missed(nominal_us, busy_us, error_percent):
    rate = 1 + error_percent / 100
    run = Run(10_000, 10_000 * rate)
    while len(run.samples) < 100:  # the loop is fast enough to measure the period of the chip
        run.poll()
    run.restart(nominal_us, nominal_us * rate)
    rng = random.Random(1)
    first, taken, before = None, 0, 0
    while run.taken < 4_000:
        run.poll(late_us=rng.choice([0] * 199 + [15_000]))
        run.now += busy_us
        if first is None and len(run.samples) > 20:
            first, taken, before = run.taken, len(run.samples), run.pacing.missed
    made = run.taken - first
    counted = len(run.samples) - taken + run.pacing.missed - before
    assert counted == pytest.approx(made, rel=0.002, abs=3)


def test_a_sample_of_a_loop_that_is_too_slow_ended_within_the_slack():
    run = Run(1_000, 1_020)
    for _ in range(2_000):
        run.poll(late_us=2_000)
        if run.samples:
            assert -LATCH_US <= run.samples[-1][1] <= run.pacing.slack_us
    assert len(run.samples) >= 1_990


@pytest.mark.parametrize("nominal_us", [8333, 10_000, 16_667, 100_000])
@pytest.mark.parametrize("error_percent", [-3, 0, 3])
def test_the_period_is_measured_to_a_few_hundredths_of_a_per_cent(nominal_us, error_percent):
    true_us = nominal_us * (1 + error_percent / 100)
    run = Run(nominal_us, true_us)
    pacing = run.pacing
    while not pacing.sampled:
        run.poll()
    assert run.taken * true_us < 8e6
    while len(run.samples) < 900:
        run.poll()
        lasted_us, longest_us = int(pacing.lasted_us), int(pacing.longest_us)
        assert lasted_us - 1 <= pacing.sampled * true_us <= longest_us + 1
        assert longest_us - lasted_us < longest_us / 2000


def test_a_short_measurement_of_the_oscillator_does_not_replace_a_long_one():
    run = Run(10_000, 10_300)
    while len(run.samples) < 3000:
        run.poll()
    for _ in range(5):
        run.restart(100_000, 103_000)
        while not run.pacing.sampled:
            run.poll(late_us=run.polls * 137 % 700)
    run.learn()
    assert run.pacing.nominal_us(1_000_000) * 1.03 == pytest.approx(1_000_000, abs=25)


@pytest.mark.parametrize("kind", [Pacing, AlignedPacing])
@pytest.mark.parametrize("seed", range(10))
def test_samples_within_a_fifo_read_are_as_held_records_them(kind, seed):
    """`Pacing.skip` is one call for many samples, and leaves the same state as `held` for each."""
    rng = random.Random(seed)
    nominal_us = rng.choice((1000, 2780, 10_000))
    true_us = nominal_us * rng.uniform(0.97, 1.03)
    busy_us = nominal_us * rng.choice((0.3, 0.95, 1.1))  # of a sample; the last is too slow
    fast, slow = kind(SmallClock), kind(SmallClock)
    now, end, followers = WRAP - 50_000.0, WRAP - 40_000.0, 0
    for pacing in (fast, slow):
        pacing.start(SmallInt(int(now)), nominal_us)
    for _ in range(1500):
        now += max(0, int(SmallClock.ticks_diff(slow.due, int(now) % WRAP)))
        if rng.random() < 0.01:
            now += rng.uniform(0, 20 * nominal_us)
        before = SmallInt(int(now) % WRAP)
        after = SmallInt(int(now + 130) % WRAP)
        samples = max(0, int((now + LATCH_US - end) // true_us) + 1)
        end += samples * true_us
        now += 130 + samples * busy_us
        if not samples:
            fast.early(before)
            slow.early(before)
        elif samples > 21:
            fast.overrun(after)
            slow.overrun(after)
        else:
            first = fast.held(before, after, samples)
            assert first == slow.held(before, after, samples)
            step_us = fast.skip(samples - 2) if samples > 2 else 0
            for n in range(1, samples - 1):
                late_us = slow.held(before, after, samples - n) - first
                assert abs(n * step_us - late_us) <= n  # rounded to 1 us for each sample
                followers += 1
            assert vars(fast) == vars(slow)
            if samples > 1:
                assert fast.held(before, after, 1) == slow.held(before, after, 1)
                assert vars(fast) == vars(slow)
    assert followers > 50
