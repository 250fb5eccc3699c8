"""Board time to host time."""

import pytest
from hypothesis import given
from hypothesis import strategies as st

from spots.clockmap import ClockMap


@given(st.lists(st.integers(-1_000_000, 2_000_000_000), max_size=50))
def test_unwrapping_follows_any_steps_shorter_than_half_a_turn(steps):
    clock, total = ClockMap(), 0
    for step in steps:
        total += step
        assert clock.unwrap(total % (1 << 32)) == total


def test_before_any_round_trip_nothing_is_known():
    assert ClockMap().host_s(5) is None
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
        error_s = clock.host_s(at_us) - (at_us * 1e-6 + offset_s)
        assert abs(error_s) <= clock.uncertainty_s + 2e-6


def test_two_lopsided_round_trips_together_beat_each_alone():
    clock = ClockMap()
    clock.round_trip(0.000, 10_000, 0.011)  # slow out, fast back
    assert clock.uncertainty_s == pytest.approx(0.0055)
    clock.round_trip(0.999, 1_000_000, 1.010)  # fast out, slow back
    assert clock.uncertainty_s == pytest.approx(0.001)
    assert clock.host_s(500_000) == pytest.approx(0.5, abs=0.0011)
