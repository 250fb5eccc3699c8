"""One touch is one key, wherever the finger goes; and the gamepad's axes."""

import pytest
from hypothesis import given
from hypothesis import strategies as st
from smallint import SmallInt

from tactile.decode import LED_OFF, MISFIT, SATURATED, TOO_DARK, TOUCHING
from tactile.gamepad import GamepadAxes
from tactile.keypad import USAGES, Keypad

LENGTH_UM = 85_000
ONE, TWO, ZERO = USAGES[0], USAGES[1], USAGES[9]


class Sink:
    def __init__(self):
        self.events = []

    def key(self, usage, modifiers, pressed):
        self.events.append((usage, pressed))


@pytest.fixture
def pad():
    sink = Sink()
    keypad = Keypad(sink)
    keypad.set_length(LENGTH_UM)
    keypad.events = sink.events
    keypad.take(0, 0, 0)
    return keypad


def touch(pad, *positions_um, flags=TOUCHING):
    for position_um in positions_um:
        pad.take(flags, position_um, 1000)


def lift(pad):
    pad.take(TOO_DARK, 0, 0)


@pytest.mark.parametrize("index", range(10))
def test_a_touch_in_a_zone_is_its_key(pad, index):
    touch(pad, LENGTH_UM * index // 10 + 1, LENGTH_UM * (index + 1) // 10 - 1)
    lift(pad)
    assert pad.events == [(USAGES[index], True), (USAGES[index], False)]


def test_a_finger_that_slides_holds_its_first_key(pad):
    touch(pad, 100, LENGTH_UM // 2, LENGTH_UM)
    assert pad.events == [(ONE, True)]
    lift(pad)
    assert pad.events == [(ONE, True), (ONE, False)]


@pytest.mark.parametrize(("position_um", "usage"), [(-500, ONE), (LENGTH_UM, ZERO), (99_000, ZERO)])
def test_the_ends_belong_to_the_last_zones(pad, position_um, usage):
    touch(pad, position_um)
    assert pad.events == [(usage, True)]


@pytest.mark.parametrize("doubt", [SATURATED, MISFIT, LED_OFF, TOO_DARK])
def test_a_doubtful_reading_presses_nothing_until_it_is_clear(pad, doubt):
    touch(pad, 0, flags=TOUCHING | doubt)
    assert pad.events == []
    touch(pad, LENGTH_UM)
    touch(pad, 0, flags=TOUCHING | doubt)
    assert pad.events == [(ZERO, True)]


def test_a_finger_that_lay_there_through_a_release_has_to_lift(pad):
    touch(pad, 0)
    pad.release()
    pad.release()
    touch(pad, 0, 0)
    assert pad.events == [(ONE, True), (ONE, False)]
    lift(pad)
    touch(pad, 0)
    assert pad.events[2:] == [(ONE, True)]


def test_another_length_lets_go(pad):
    touch(pad, 0)
    pad.set_length(2 * LENGTH_UM)
    lift(pad)
    touch(pad, LENGTH_UM // 5 + 1)
    assert pad.events == [(ONE, True), (ONE, False), (TWO, True)]


@given(
    length_um=st.integers(0, 1 << 28),
    readings=st.lists(
        st.tuples(st.integers(0, 255), st.integers(-(1 << 28), 1 << 28), st.integers(0, 65_535)),
        max_size=30,
    ),
)
def test_presses_and_releases_alternate_in_integers_of_31_bits(length_um, readings):
    sink = Sink()
    keypad = Keypad(sink)
    keypad.set_length(SmallInt(length_um))
    for flags, position_um, force_mN in readings:
        keypad.take(SmallInt(flags), SmallInt(position_um), SmallInt(force_mN))
    keypad.release()
    assert [pressed for _, pressed in sink.events] == [True, False] * (len(sink.events) // 2)
    assert [usage for usage, _ in sink.events[::2]] == [usage for usage, _ in sink.events[1::2]]


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
