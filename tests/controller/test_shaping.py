"""Response curves of an axis: exact at ends and middle, monotone, symmetric."""

import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from spots.controller.shaping import deadband, deflection, expo, shaped

U = st.floats(-1, 1)
WIDTH = st.floats(0, 0.9)
AMOUNT = st.floats(0, 1)
ROUNDING = 1e-12


@given(WIDTH, AMOUNT, st.booleans())
def test_ends_and_middle_are_exact(width, amount, invert):
    sign = -1 if invert else 1
    assert shaped(1, width, amount, invert) == sign
    assert shaped(-1, width, amount, invert) == -sign
    assert shaped(0, width, amount, invert) == 0


@given(U, WIDTH, AMOUNT)
def test_both_sides_are_the_same(u, width, amount):
    assert shaped(-u, width, amount, False) == -shaped(u, width, amount, False)
    assert shaped(u, width, amount, True) == -shaped(u, width, amount, False)


@given(U, U, WIDTH, AMOUNT)
def test_more_is_never_less(a, b, width, amount):
    low, high = sorted((a, b))
    assert shaped(low, width, amount, False) <= shaped(high, width, amount, False) + ROUNDING


@given(WIDTH, st.floats(0, 1))
def test_the_deadband_is_as_wide_as_it_says_and_begins_at_0(width, share):
    assert deadband(share * width, width) == 0
    just_beyond = math.nextafter(width, 1)
    assert 0 < deadband(just_beyond, width) < 1e-12
    assert deadband(-just_beyond, width) == -deadband(just_beyond, width)


@given(U)
def test_nothing_asked_for_is_nothing_done(u):
    assert shaped(u, 0, 0, False) == u


def test_expo_is_a_mix_with_the_cube():
    assert expo(0.5, 1) == 0.125
    assert expo(0.5, 0.5) == pytest.approx((0.5 + 0.125) / 2)


@given(st.floats(1, 99), st.floats(-50, 150))
def test_rest_is_its_own_place_between_the_ends(rest, value):
    u = deflection(value, rest, 0, 100)
    assert deflection(0, rest, 0, 100) == -1
    assert deflection(rest, rest, 0, 100) == 0
    assert deflection(100, rest, 0, 100) == 1
    assert -1 <= u <= 1
    assert math.copysign(1, u) == math.copysign(1, value - rest) or u == 0


def test_an_axis_of_one_side_stays_at_rest_on_the_other():
    assert deflection(100, 300, -math.inf, 6000) == 0
    assert deflection(3150, 300, -math.inf, 6000) == pytest.approx(0.5)
    assert deflection(9000, 300, -math.inf, 6000) == 1
