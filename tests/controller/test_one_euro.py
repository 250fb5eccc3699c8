"""The 1-Euro filter on signals with a known result."""

import math
import random
import statistics

import pytest

from spots.controller.one_euro import OneEuro

DT_S = 0.01


def filtered(signal, min_cutoff_hz=2.0, beta=0.0, dt_s=DT_S):
    one = OneEuro(min_cutoff_hz, beta, 10.0)
    return [one.take(value, dt_s) for value in signal]


def test_the_first_value_comes_out_as_it_is_and_a_constant_stays():
    assert filtered([0.3] * 50, beta=16.0) == [0.3] * 50


def test_without_beta_a_step_is_that_of_a_first_order_low_pass():
    answer = filtered([0.0] + [1.0] * 30)
    alpha = 1 / (1 + 1 / (2 * math.pi * 2.0 * DT_S))
    for n, value in enumerate(answer):
        assert value == pytest.approx(1 - (1 - alpha) ** n)


def test_what_passes_at_the_cutoff_is_what_a_low_pass_lets_through():
    # The sampling rate is so high that the filter acts like a continuous one: gain 1/sqrt(2).
    dt_s = 1e-4
    sine = [math.sin(2 * math.pi * 2.0 * i * dt_s) for i in range(30_000)]
    assert max(filtered(sine, dt_s=dt_s)[-10_000:]) == pytest.approx(0.5**0.5, rel=0.01)


def test_beta_takes_the_lag_out_of_what_moves_and_leaves_what_rests():
    ramp = [2.0 * i * DT_S for i in range(200)]  # two full scales a second
    lag = [ramp[-1] - filtered(ramp, beta=beta)[-1] for beta in (0.0, 4.0, 16.0)]
    assert lag[0] == pytest.approx(2.0 / (2 * math.pi * 2.0), rel=0.1)  # speed by time constant
    assert lag[2] < lag[1] / 2 < lag[0] / 4
    noise = random.Random(1)
    resting = [noise.gauss(0.0, 0.001) for _ in range(2000)]
    calm = statistics.stdev(filtered(resting, beta=16.0)[100:])
    assert calm < 0.4 * statistics.stdev(resting)


def test_what_comes_out_is_never_beyond_what_went_in():
    noise = random.Random(2)
    signal = [noise.uniform(-1, 1) for _ in range(500)]
    answer = filtered(signal, beta=100.0)
    for i in range(len(signal)):
        assert min(signal[: i + 1]) <= answer[i] <= max(signal[: i + 1])


def test_a_reading_that_comes_twice_changes_nothing():
    one = OneEuro(2.0, 16.0, 10.0)
    one.take(0.0, 0.0)
    value = one.take(0.5, DT_S)
    assert one.take(1.0, 0.0) == value


def test_after_a_reset_nothing_is_remembered():
    one = OneEuro(2.0, 0.0, 10.0)
    one.take(1.0, DT_S)
    one.reset()
    assert one.take(-1.0, DT_S) == -1.0
