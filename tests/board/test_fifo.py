"""The chip's FIFO: a stall of the loop loses no sample, and its counts equal the polled counts."""

import contextlib
import errno
import itertools
import random

import numpy as np
import pytest

from spots.link.board import Board
from spots.link.frames import Spectrum
from spots_device.reading.decode import DROPPED
from spots_sim.board.lockstep import LockstepLink
from spots_sim.board.protocol import protocol
from spots_sim.chip.as7341 import AS7341
from spots_sim.chip.converter import DIODES, GAIN, ChipNoise
from spots_sim.chip.quirks import Quirks
from spots_sim.strip.scenario import Held

pytestmark = pytest.mark.board

BOARDS = ["virtual", "virtual_circuitpython"]
SILENT = ChipNoise(read_counts=0.0, electrons_per_count_1x=1e30, dark_counts_512x=0.0)
EXPOSURE_US = 2_780
AROUND = 400
GAIN_64X = 7


class Numbered:
    """Simulated light with which each diode and each sample has other counts.

    The counts repeat after 400 samples.
    """

    def __init__(self):
        self.samples = 0

    def collect(self, start_us, end_us, led_mA):
        number = self.samples % AROUND
        self.samples += 1
        return {name: (number + 50 * i) / GAIN[GAIN_64X] for i, name in enumerate(DIODES)}

    def temperature_C(self, now_us):
        return 25.0


class Stalled:
    """A board under `Numbered` light, which streams SPECTRUM frames; its loop can stall."""

    def __init__(self, sensor, board="virtual", exposure_us=EXPOSURE_US, busy_us=None, **quirks):
        self.link = LockstepLink(sensor, Held(), board=board, busy_us=busy_us)
        rng = np.random.default_rng(0)
        self.chip = AS7341(Numbered(), SILENT, rng, Quirks(**quirks))
        self.link.bus.chip = self.link.chip = self.chip
        self.board = Board(self.link)
        self.board.command(f"set exposure_us={exposure_us} gain={GAIN_64X} led=always")
        self.board.command("stream spectrum")
        self.run(0.3)

    def run(self, seconds):
        return [f for f in self.board.frames(seconds=seconds) if isinstance(f, Spectrum)]

    def get(self):
        return self.board.command("get")

    def stall(self, stall_us):
        self.link.clock.spend_us(stall_us)


@pytest.fixture
def stalled(sensor):
    with contextlib.ExitStack() as boards:

        def make(*arguments, **options):
            made = Stalled(sensor, *arguments, **options)
            boards.enter_context(made.board)
            return made

        yield make


def numbers(frames):
    """Return the number of the sample in each frame; all six counts of a frame must agree on it."""
    for frame in frames:
        assert not (np.diff(frame.counts) % 50).any(), frame.counts
        assert frame.counts[0] < frame.counts[1]
    return [frame.counts[0] for frame in frames]


def steps(frames):
    """Return the set of differences between the sample numbers of successive frames."""
    return {(b - a) % AROUND for a, b in itertools.pairwise(numbers(frames))}


@pytest.mark.parametrize(
    ("board", "error_percent"), [(BOARDS[0], -3.0), (BOARDS[0], 3.0), (BOARDS[1], 0.0)]
)
def test_a_stall_of_50_ms_loses_no_sample(stalled, board, error_percent):
    made = stalled(board, clock_error_percent=error_percent)
    assert made.get()["fifo"]
    frames = []
    for stall_us in (50_000, 11_000, 50_000, 3_000, 50_000):
        frames += made.run(0.2)
        made.stall(stall_us)
    frames += made.run(0.2)
    assert len(frames) > 380
    assert steps(frames) == {1}
    assert not any(frame.flags & DROPPED for frame in frames)
    assert made.get()["missed"] == 0
    # The times of the frames follow the chip's period, also during a stall.
    times_us = np.unwrap(np.array([frame.t_us for frame in frames], float), period=2.0**32)
    period_us = EXPOSURE_US * (1 + error_percent / 100)
    late_us = times_us - period_us * np.arange(len(frames))
    assert np.ptp(late_us) < 500


@pytest.mark.parametrize("board", BOARDS)
def test_the_fifo_has_the_counts_of_the_data_registers(stalled, board):
    found = []
    # A FIFO that is not as the driver expects is not used.
    for quirks in ({}, {"fifo_reversed": True}, {"fifo_level_alone": True}):
        made = stalled(board, **quirks)
        frames = made.run(2.0)
        assert made.get()["fifo"] == (not quirks)
        found.append({frame.counts[0]: tuple(frame.counts) for frame in frames})
    assert len(found[0]) == AROUND
    assert found[0] == found[1] == found[2]


@pytest.mark.parametrize(
    ("stall_us", "overwrites"), [(61_000, False), (70_000, True), (2_000_000, False)]
)
def test_an_overflow_is_counted_and_the_fifo_is_used_again(stalled, stall_us, overwrites):
    made = stalled(fifo_overwrites=overwrites, clock_error_percent=2.0)
    made.run(0.5)
    before = made.get()["missed"]
    frames = made.run(0.1)
    made.stall(stall_us)
    after = made.run(0.5)
    lost = made.get()["missed"] - before
    assert steps(frames) == {1}
    gap = (numbers(after)[0] - numbers(frames)[-1]) % AROUND
    assert steps(after) == {1}
    lost_by_chip = stall_us / (1.02 * EXPOSURE_US)
    turns = round((lost_by_chip - gap) / AROUND)
    # The period is measured to 0.1 %: after 2 s, the count may be wrong by one.
    assert abs(lost - (gap - 1 + AROUND * turns)) <= stall_us // 2_000_000
    assert after[0].flags & DROPPED
    assert made.get()["fifo"]


@pytest.mark.usefixtures("in_micropython")  # for `busy_us`
def test_the_samples_of_a_board_that_misses_most_are_whole_and_their_times_right(stalled):
    made = stalled(busy_us=6_000.0, clock_error_percent=1.0)
    ends_us, complete = {}, made.chip._complete
    offset = 50 * DIODES.index(made.get()["channels"][0])

    def record(end_us):
        ends_us[made.chip._light.samples % AROUND + offset] = end_us
        complete(end_us)

    made.chip._complete = record
    made.run(0.2)
    frames = made.run(0.8)
    assert any(frame.flags & DROPPED for frame in frames)
    ends = [ends_us[number] for number in numbers(frames)]
    late_us = [frame.t_us + EXPOSURE_US / 2 - end_us for frame, end_us in zip(frames, ends)]
    assert min(late_us) > -0.1 * EXPOSURE_US
    assert max(late_us) < 1.2 * EXPOSURE_US


class FullBus:
    """An I2C bus that delays one read of the FIFO level until the FIFO has `level` entries.

    Before the following read of data, the chip stores one more sample.
    """

    def __init__(self, link, level):
        self._bus, self._clock, self._chip = link.bus, link.clock, link.chip
        self.level, self.grew = level, False

    def __getattr__(self, name):
        return getattr(self._bus, name)

    def write_read(self, address, data, size):
        if data == b"\xfd" and self.level:
            while len(self._chip._fifo) < self.level:
                self._clock.spend_us(50.0)
                self._chip.advance(self._clock.now_us())
            self.level = 0
        elif data == b"\xfe" and not self.level and not self.grew:
            self.grew = True
            self._clock.spend_us(EXPOSURE_US)
        return self._bus.write_read(address, data, size)


@pytest.mark.parametrize("level", [114, 120, 126])
def test_a_sample_that_the_chip_stores_after_the_level_was_read_is_whole(stalled, level):
    made = stalled()
    made.run(0.2)
    made.link.bus = bus = FullBus(made.link, level)
    frames = made.run(0.5)
    assert bus.grew
    assert len(numbers(frames)) > 100
    assert made.get()["fifo"]


def test_a_shifted_fifo_is_emptied(stalled):
    made = stalled()
    made.run(0.2)
    made.chip._fifo.entries[:] = [b"\1\0"]  # as after clocks that the chip missed
    made.run(0.1)
    assert steps(made.run(0.3)) == {1}
    assert made.get()["missed"] >= 1


class Cut:
    """An I2C bus on which some transfers from the FIFO fail in the middle."""

    def __init__(self, bus, after):
        self._bus, self.left, self._after = bus, 0, after

    def __getattr__(self, name):
        return getattr(self._bus, name)

    def write_read(self, address, data, size):
        if data == b"\xfe" and self.left:
            self.left -= 1
            self._bus.write_read(address, data, self._after)
            self._bus.refuse()
        return self._bus.write_read(address, data, size)


@pytest.mark.parametrize("after", [2, 5, 12])
def test_a_transfer_that_fails_in_the_middle_costs_samples_that_are_counted(stalled, after):
    made = stalled()
    made.link.bus = cut = Cut(made.link.bus, after)
    frames = made.run(0.2)
    for _ in range(10):
        cut.left = 1
        frames += made.run(0.1)
    assert not cut.left
    gaps = [(b - a) % AROUND for a, b in itertools.pairwise(numbers(frames))]
    state = made.get()
    assert max(gaps) <= 3
    assert state["missed"] == sum(gaps) - len(gaps)
    assert state["retries"] == 10


class LateBus:
    """An I2C bus that stalls in the firmware's test of the FIFO, and before the FIFO is emptied."""

    def __init__(self, bus, clock, *stalls_us):
        self._bus, self._clock, self.stalls_us = bus, clock, list(stalls_us)
        self._last = None

    def __getattr__(self, name):
        return getattr(self._bus, name)

    def write(self, address, data):
        if data == b"\xfa\x02":
            self._clock.spend_us(EXPOSURE_US)
        self._bus.write(address, data)

    def write_read(self, address, data, size):
        # Only the self-test reads the level after the status.
        if data == b"\xfd" and self._last == b"\x93" and self.stalls_us:
            self._clock.spend_us(self.stalls_us.pop(0))
        self._last = data
        return self._bus.write_read(address, data, size)


def test_a_stall_during_the_self_test_leaves_the_fifo_in_use(stalled):
    made = stalled()
    made.link.bus = bus = LateBus(made.link.bus, made.link.clock, 70_000, EXPOSURE_US)
    made.board.command("set gain=6")
    made.run(0.3)
    assert not bus.stalls_us
    assert made.get()["fifo"]


@pytest.mark.parametrize("board", BOARDS)
def test_an_oscillator_that_jumps_costs_counted_samples_and_tears_none(stalled, board):
    made = stalled(board)
    made.run(0.6)
    before = made.get()["missed"]
    last = numbers(made.run(0.1))[-1]
    found, retreats = [last], 0
    for _ in range(20):
        # The end of the present sample moves by up to a period: polls that were certain to find a
        # sample find an empty FIFO, some of them while the sample is stored.
        made.chip._end_us += 90 + 7 * retreats
        retreats += 1
        found += numbers(made.run(0.3))  # asserts that no sample consists of two
    lost = sum((b - a) % AROUND - 1 for a, b in itertools.pairwise(found))
    assert all(0 < (b - a) % AROUND < 4 for a, b in itertools.pairwise(found))
    assert lost <= made.get()["missed"] - before <= lost + retreats
    assert made.get()["fifo"]


class DeafBus:
    """An I2C bus on which some reads of the FIFO's level fail: those of `size` bytes."""

    def __init__(self, link, size, fails):
        self._bus = link.bus
        self._size, self.fails = size, fails

    def __getattr__(self, name):
        return getattr(self._bus, name)

    def write_read(self, address, data, size):
        if data == b"\xfd" and size == self._size and self.fails:
            self.fails -= 1
            raise OSError(errno.ENODEV, "no acknowledgement")
        return self._bus.write_read(address, data, size)


@pytest.mark.parametrize(("size", "lost"), [(1, 0), (13, 5)])
def test_a_failed_transfer_costs_at_most_the_sample_that_it_read(stalled, size, lost):
    made = stalled()
    made.run(1.0)
    made.link.bus = bus = DeafBus(made.link, size, 5)
    frames = made.run(1.0)
    reply = made.get()
    assert not bus.fails
    assert reply["retries"] == 5
    missing = sum((b - a) % AROUND - 1 for a, b in itertools.pairwise(numbers(frames)))
    assert missing == reply["missed"] <= lost
    assert reply["fifo"]


class RefusingBus:
    """An I2C bus on which the chip refuses the first data byte of some transfers.

    `machine.I2C` of an RP2040 then raises no OSError: a read leaves its buffer unchanged.
    """

    def __init__(self, bus):
        self._bus, self._rng = bus, random.Random(1)
        self.share = 0.0
        self.refused = 0

    def __getattr__(self, name):
        return getattr(self._bus, name)

    def write(self, address, data):
        self._refuse()
        self._bus.write(address, data)

    def write_read(self, address, data, size):
        self._refuse()
        return self._bus.write_read(address, data, size)

    def _refuse(self):
        if self._rng.random() < self.share:
            self.refused += 1
            raise OSError(protocol.REFUSED, "no acknowledgement of a data byte")


@pytest.mark.parametrize(
    ("alone", "exposure_us"),
    [(False, 2_780), (True, 185_000)],
    ids=["fifo", "registers"],
)
def test_a_silently_refused_transfer_gives_no_old_sample(stalled, alone, exposure_us):
    made = stalled(exposure_us=exposure_us, fifo_level_alone=alone)
    made.link.bus = bus = RefusingBus(made.link.bus)
    made.run(6 * exposure_us * 1e-6 + 0.3)
    before = made.get()
    bus.share = 0.03
    frames = made.run(1_000 * exposure_us * 1e-6 if exposure_us < 10_000 else 40.0)
    bus.share = 0.0
    reply = made.get()
    assert bus.refused > 5
    assert reply["faults"] == 0
    assert reply["retries"] - before["retries"] > 0.7 * bus.refused
    assert reply["fifo"] == (not alone)
    # No sample is there two times, none consists of two, and the missing ones are counted.
    gaps = [(b - a) % AROUND - 1 for a, b in itertools.pairwise(numbers(frames))]
    assert all(0 <= gap < 20 for gap in gaps)
    assert sum(gaps) <= reply["missed"] - before["missed"] <= sum(gaps) + 2
