"""Conversion of board time to host time."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from spots.link.clockmap import ClockMap


@given(st.lists(st.integers(-1_000_000, 2_000_000_000), max_size=50))
def test_unwrapping_follows_any_steps_shorter_than_half_a_turn(steps):
    clock, total = ClockMap(), 0
    for step in steps:
        total += step
        assert clock.unwrap(total % (1 << 32)) == total


def test_before_any_round_trip_nothing_is_known():
    assert ClockMap().host_s(5, 1.0) is None
    assert ClockMap().uncertainty_s == float("inf")


@given(st.floats(-1e5, 1e5), st.lists(st.tuples(delays := st.floats(0, 0.05), delays), min_size=1))
def test_the_truth_lies_within_the_uncertainty(offset_s, trips):
    clock = ClockMap()
    now_s = 0.0
    for out_s, back_s in trips:
        now_s += 0.1
        answered_us = round((now_s + out_s) * 1e6)
        clock.round_trip(now_s + offset_s, answered_us, now_s + out_s + back_s + offset_s)
        at_us = answered_us + 5000
        error_s = clock.host_s(at_us, at_us * 1e-6 + offset_s) - (at_us * 1e-6 + offset_s)
        assert abs(error_s) <= clock.uncertainty_s + 2e-6


def test_two_lopsided_round_trips_together_beat_each_alone():
    clock = ClockMap()
    clock.round_trip(0.000, 10_000, 0.011)  # slow command, fast reply
    assert clock.uncertainty_s == pytest.approx(0.0055)
    clock.round_trip(0.999, 1_000_000, 1.010)  # fast command, slow reply
    assert clock.uncertainty_s == pytest.approx(0.001)
    assert clock.host_s(500_000, 1.0) == pytest.approx(0.5, abs=0.0011)


@pytest.mark.parametrize("pause_s", [600.0, 2400.0, 4200.0, 4300.0, 90_000.0])
@pytest.mark.parametrize("waited_s", [0.0, 0.5, 1800.0])
def test_a_board_that_nobody_read_for_long_has_the_right_time(pause_s, waited_s):
    clock, offset_s = ClockMap(), 1234.5

    def told(board_s, after_s=0.0):
        return clock.host_s(round(board_s * 1e6) % (1 << 32), board_s + after_s + offset_s)

    def trip(board_s):
        clock.round_trip(offset_s + board_s, round(board_s * 1e6) % (1 << 32), offset_s + board_s)

    trip(2000.0)
    assert told(2000.0 + 1e-3) == pytest.approx(offset_s + 2000.0, abs=0.01)
    if waited_s < pause_s < 4000.0:  # a reading from before the pause may still be in a buffer
        assert told(2001.0, waited_s) == pytest.approx(offset_s + 2001.0, abs=0.01)
    now_s = 2000.0 + pause_s
    assert told(now_s, min(waited_s, 1.0)) == pytest.approx(offset_s + now_s, abs=0.01)
    trip(now_s + 1)
    assert clock.uncertainty_s < 1e-3
    assert told(now_s + 2) == pytest.approx(offset_s + now_s + 2, abs=0.01)


@pytest.mark.parametrize("slept_s", [0.3, 40.0, 600.0, 2400.0, 4200.0, 30_000.0])
def test_a_computer_that_slept_takes_arrivals_until_the_next_round_trip(slept_s):
    # Besides the state of the board class, which test_restart tries: wraps of the board's time.
    clock, each = ClockMap(), ClockMap()
    board_s = 1000.0 + np.arange(400) * 0.01
    host_s = np.where(np.arange(400) < 200, board_s, board_s - 0.003) + 50.0
    board_s[200:] += slept_s
    t_us = np.round(board_s * 1e6).astype(np.int64) % (1 << 32)
    for one in (clock, each):
        one.round_trip(1049.999, 1_000_000_000, 1050.001)
        one.round_trip(1049.9995, 1_000_000_500, 1050.0015)
    times = [clock.host_s(*one) for one in zip(t_us.tolist(), host_s.tolist())]
    assert each.host_s_each(t_us, host_s).tolist() == times
    assert times == pytest.approx(host_s.tolist(), abs=0.004)
    assert clock.jumps == 1
    assert clock.slept_s == pytest.approx(slept_s % (2**32 * 1e-6), abs=0.01)
    clock.round_trip(host_s[-1], int(t_us[-1]), host_s[-1] + 2e-4)
    assert clock.uncertainty_s == pytest.approx(1e-4, rel=0.01)


def test_of_contradicting_round_trips_the_older_ones_are_dropped():
    clock = ClockMap()
    for i in range(70):
        clock.round_trip(5.0 + i, i * 1_000_000, 5.001 + i)
    clock.round_trip(75.0 - 30.0, 70_000_000, 75.001 - 30.0)  # no reading showed the sleep
    assert clock.uncertainty_s == pytest.approx(0.0005)
    assert clock.host_s(71_000_000, 46.01) == pytest.approx(46.0005, abs=1e-6)
    assert (clock.jumps, clock.slept_s) == (1, pytest.approx(30.0, abs=0.001))
    clock.round_trip(76.0 - 30.002, 71_000_000, 76.0005 - 30.002)  # less than what shows a sleep
    assert clock.uncertainty_s < 0.001
    assert clock.jumps == 1
