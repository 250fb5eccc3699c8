"""log2 in Q20: error of at most one unit for every argument, integers within 31 bits."""

import math

import pytest
from hypothesis import given
from hypothesis import strategies as st
from support.smallint import SmallInt, small

from spots_device.reading import log2


def error_units(n):
    return abs(log2.log2_q20(n) - math.log2(n) * log2.ONE)


def test_every_16_bit_count_is_within_one_unit():
    assert max(error_units(n) for n in range(1, 1 << 16)) <= 1


def test_samples_up_to_24_bits_are_within_one_unit():
    # 4999 is prime, so the arguments are at all positions between two entries of the table.
    assert max(error_units(n) for n in range(1 << 16, log2.LIMIT + 1, 4999)) <= 1
    assert max(error_units(n) for n in range(log2.LIMIT - 5000, log2.LIMIT + 1)) <= 1


@given(st.integers(1, log2.LIMIT))
def test_any_argument_is_within_one_unit(n):
    assert error_units(n) <= 1


@pytest.mark.parametrize("exponent", range(25))
def test_powers_of_two_are_whole_within_one_unit(exponent):
    assert error_units(1 << exponent) <= 1


def test_never_falls_where_the_argument_rises():
    values = [log2.log2_q20(n) for n in range(1, 1 << 16)]
    assert values == sorted(values)


@given(st.integers(1, log2.LIMIT))
def test_stays_inside_31_bits(n):
    table = log2.TABLE
    try:
        log2.TABLE = small(table)
        assert log2.log2_q20(SmallInt(n)) == _plain(n, table)
    finally:
        log2.TABLE = table


def _plain(n, table):
    checked, log2.TABLE = log2.TABLE, table
    try:
        return log2.log2_q20(n)
    finally:
        log2.TABLE = checked
