"""Readings move the axes of a gamepad; all integers fit 31 bits."""

import pytest
from hypothesis import given
from hypothesis import strategies as st
from support.smallint import SmallInt

from spots_device.keys.gamepad import GamepadAxes
from spots_device.reading.decode import (
    FITS_WITH_DRIFT,
    LED_OFF,
    MISFIT,
    TOO_DARK,
    TOUCHING,
)

LENGTH_UM = 85_000


class Axes:
    def __init__(self):
        self.now = None

    def update(self, *axes):
        self.now = tuple(int(axis) for axis in axes)

    def release(self):
        self.now = "released"


@pytest.fixture
def axes():
    sink = Axes()
    made = GamepadAxes(sink)
    made.set_range(LENGTH_UM, 5000)
    made.sink = sink
    return made


@pytest.mark.parametrize(
    ("position_um", "force_mN", "state"),
    [
        (0, 0, (-32_767, 0, 0, 1)),
        (LENGTH_UM, 5000, (32_767, 0, 32_760, 1)),
        (LENGTH_UM // 2, 2500, (0, 0, 16_376, 1)),
        (-7, 60_000, (-32_767, 0, 32_760, 1)),
        (10 * LENGTH_UM, 1, (32_767, 0, 0, 1)),
    ],
)
def test_where_and_how_hard(axes, position_um, force_mN, state):
    axes.take(TOUCHING, position_um, force_mN)
    assert axes.sink.now == state


def test_without_a_touch_all_is_0_and_a_doubtful_reading_changes_nothing(axes):
    axes.take(TOUCHING, LENGTH_UM, 5000)
    before = axes.sink.now
    axes.take(TOUCHING | LED_OFF, 0, 0)
    assert axes.sink.now == before
    axes.take(TOO_DARK, 0, 0)
    assert axes.sink.now == (0, 0, 0, 0)


def test_a_reading_that_fits_one_press_up_to_the_drift_moves_the_axes(axes):
    axes.take(TOUCHING | FITS_WITH_DRIFT, LENGTH_UM, 5000)
    assert axes.sink.now == (32_767, 0, 32_760, 1)
    axes.take(TOUCHING | MISFIT, 0, 5000)
    assert axes.sink.now == (32_767, 0, 32_760, 1)


@given(
    length_um=st.integers(0, 1 << 28),
    full_mN=st.integers(1, 65_535),
    position_um=st.integers(-(1 << 28), 1 << 28),
    force_mN=st.integers(0, 65_535),
)
def test_axes_are_in_range_and_in_integers_of_31_bits(length_um, full_mN, position_um, force_mN):
    sink = Axes()
    axes = GamepadAxes(sink)
    axes.set_range(SmallInt(length_um), SmallInt(full_mN))
    axes.take(TOUCHING, SmallInt(position_um), SmallInt(force_mN))
    x, _, z, _ = sink.now
    assert -32_767 <= x <= 32_767
    assert 0 <= z <= 32_767
    inside = min(max(position_um, 0), max(1, length_um))
    assert abs(x - (65_536 * inside / max(1, length_um) - 32_768)) <= 2
