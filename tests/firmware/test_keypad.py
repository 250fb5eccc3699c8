"""Touches on keys cause the actions of the layout, and no key stays pressed."""

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from support import keys
from support.keys import LENGTH_UM, Desk, clicks, key, letter, limit, rolled
from support.smallint import SmallInt

from spots_device.fingers.state import TICKS
from spots_device.keys.layout import (
    BALANCED,
    BEHAVIOUR,
    CAPS_SIZE,
    CAPS_WORD,
    HOLD_PREFERRED,
    HOLD_TAP,
    KEY_REPEAT,
    MOD_MORPH,
    MOMENTARY,
    STICKY,
    TAP_DANCE,
    TAP_PREFERRED,
    TOGGLE,
    action,
    default_lines,
)
from spots_device.reading.decode import MISFIT, TOUCHING

A, B, C, D, E, F = range(4, 10)
SHIFT = 0xE1
TAPPING_MS, QUICK_MS, DOUBLE_MS = (
    limit("tapping_term_ms"),
    limit("quick_tap_ms"),
    limit("double_ms"),
)
WRAP_MS = TICKS * 1024 // 1000  # when the time of a reading starts again at 0
PLAIN = key(500, 1000, letter(B))


def one(*keys, **statements):
    """Return a `Desk` with a layout of one layer with these keys.

    `statements` are further statements of the layout, such as ``firm_ms=80``.
    """
    lines = [f"{name} {value}" for name, value in statements.items()]
    return Desk(*lines, "layer 0 0", *keys)


@pytest.mark.parametrize("index", range(10))
def test_without_a_layout_there_are_ten_keys_in_a_row(index):
    desk = Desk(*default_lines())
    desk.tap(10 * index + 0.1)
    desk.tap(10 * index + 9.9)
    assert desk.events == clicks(30 + index, 30 + index)


@pytest.fixture
def fast(monkeypatch):
    """Readings every 4 ms."""
    monkeypatch.setattr(keys, "READING_MS", 4)


def soft(desk, *presses):
    """Give the desk a reading for each position in mm and force in mN."""
    for x_mm, force_mN in presses:
        desk.press(x_mm, keys.READING_MS, force_mN)


def test_a_soft_touch_near_a_border_waits_until_its_key_is_certain(fast):
    desk = one(key(0, 500, letter(A)), PLAIN)
    soft(desk, (49.8, 150), (49.8, 200), (50.9, 900))
    assert desk.events == [(B, True)]


def test_a_touch_that_stays_uncertain_is_pressed_soon(fast):
    desk = one(key(0, 500, letter(A)), PLAIN)
    soft(desk, *[(49.8, 150)] * 2)
    assert desk.events == []
    soft(desk, (49.8, 150))
    assert desk.events == [(A, True)]


@pytest.mark.parametrize("x_mm", [25, 75])
def test_a_soft_touch_within_a_key_does_not_wait(fast, x_mm):
    desk = one(key(0, 500, letter(A)), PLAIN)
    soft(desk, (x_mm, 150), (x_mm, 150))
    assert len(desk.events) == 1


def test_a_touch_that_ends_while_its_key_is_uncertain_is_typed(fast):
    desk = one(key(0, 500, letter(A)), PLAIN)
    soft(desk, *[(49.8, 150)] * 2)
    assert desk.events == []
    desk.lift()
    assert desk.events == clicks(A)


def test_a_touch_that_waits_has_the_time_of_its_first_light(fast):
    desk = one(key(0, 500, letter(A), double=letter(C)), PLAIN, double_ms=100)
    desk.tap(40, gap_ms=92)
    soft(desk, (49.8, 150), (49.8, 200), (49.8, 200), (49.8, 900))
    desk.lift()
    assert desk.events == clicks(C)


@pytest.mark.parametrize(("x_mm", "usage"), [(-0.5, 30), (100, 39), (120, 39)])
def test_the_ends_belong_to_the_outermost_keys(x_mm, usage):
    desk = Desk(*default_lines())
    desk.tap(x_mm)
    assert desk.events == clicks(usage)


def test_between_keys_there_is_none():
    desk = one(key(100, 400, letter(A)), key(600, 900, letter(B)))
    for x_mm in (5, 50, 95):
        desk.tap(x_mm)
    assert desk.events == []
    desk.press(50)
    desk.slide(50, 70, 200)  # the touch began between two keys, and reaches a key
    desk.slide(70, 20, 200)
    desk.lift()
    assert desk.events == clicks(B)


def test_modifiers_go_with_their_key():
    desk = one(key(0, 1000, letter(A, 2)))
    desk.tap(50)
    assert desk.modifiers == [2]


def test_a_key_is_held_as_long_as_the_finger():
    desk = one(key(0, 1000, letter(A)))
    desk.press(50, 5000)
    assert desk.events == [(A, True)]


HOLD = key(0, 500, letter(A), hold=letter(SHIFT))


def test_a_tap_is_one_action_and_a_hold_another():
    desk = one(HOLD)
    desk.tap(20, TAPPING_MS - 50)
    assert desk.events == clicks(A)
    desk.lift(1000)
    desk.press(20, TAPPING_MS + 40)
    assert desk.events[2:] == [(SHIFT, True)]
    desk.lift()
    assert desk.events[2:] == clicks(SHIFT)


def test_a_quick_tap_and_a_hold_repeat_the_tap():
    desk = one(HOLD)
    desk.tap(20, 60, QUICK_MS - 90)
    desk.press(20, 1000)
    assert desk.events == [*clicks(A), (A, True)]
    desk.lift(QUICK_MS + 40)
    desk.press(20, 1000)
    assert desk.events == [*clicks(A, A), (SHIFT, True)]


def test_of_a_rolling_second_finger_the_flavor_decides():
    for flavor, events in {
        HOLD_PREFERRED: [(SHIFT, True), (B, True), (SHIFT, False), (B, False)],
        TAP_PREFERRED: rolled(A, B),
    }.items():
        desk = one(HOLD, PLAIN, flavor=flavor)
        desk.press(20, 100)
        desk.press(80, 100)
        desk.lift()
        assert desk.events == events


DOUBLE = key(0, 500, letter(A), double=letter(C))


def test_two_taps_are_one_action_and_one_comes_when_there_is_no_second():
    desk = one(DOUBLE, PLAIN)
    desk.tap(20, 60, 80)
    assert desk.events == []
    desk.press(20)
    assert desk.events == [(C, True)]
    desk.lift()
    assert desk.events == clicks(C)
    desk.tap(20, 60, DOUBLE_MS + 60)
    assert desk.events == clicks(C, A)


def test_another_key_ends_the_wait_for_a_second_tap():
    desk = one(DOUBLE, PLAIN)
    desk.tap(20, 60, 60)
    desk.tap(80)
    assert desk.events == clicks(A, B)


def test_a_firm_press_is_another_level_decided_when_it_gets_firm():
    desk = one(key(0, 1000, letter(A), firm=letter(D)))
    desk.press(50, 40, force_mN=1000)
    assert desk.events == []
    desk.press(50, 40, force_mN=limit("firm_mN"))
    assert desk.events == [(D, True)]
    desk.lift()
    desk.tap(50, 40)
    assert desk.events == clicks(D, A)
    desk.press(50, limit("firm_ms") + 40)
    desk.press(50, 100, force_mN=9000)  # too late for a firm press: the tap was typed already
    assert desk.events[4:] == [(A, True)]


SLIDER = key(0, 1000, letter(A), minus=letter(E), plus=letter(F))


def test_a_slide_is_a_click_at_every_step_and_no_tap():
    desk = one(SLIDER, slide_um=5000)
    desk.press(20)
    desk.slide(20, 36, 200)
    assert desk.events == clicks(F, F, F)
    desk.slide(36, 20, 200)
    desk.lift()
    assert desk.events == clicks(F, F, F, E, E, E)
    desk.tap(20)
    assert desk.events[12:] == clicks(A)


def test_a_swipe_is_the_layers_and_no_key():
    desk = Desk(f"layer {letter(E)} {letter(F)}", key(0, 1000, letter(A)), "swipe_um 15000")
    desk.press(20, 30)
    desk.slide(20, 60, 120)
    desk.lift()
    assert desk.events == clicks(F)
    desk.press(60, 30)
    desk.slide(60, 20, 120)
    desk.lift()
    desk.tap(50, 60)
    assert desk.events == clicks(F, E, A)


def test_a_slow_move_is_no_swipe():
    desk = Desk(f"layer {letter(E)} {letter(F)}", key(0, 1000, letter(A)), "swipe_ms 100")
    desk.press(20, 30)
    desk.slide(20, 60, 400)
    desk.lift()
    assert desk.events == clicks(A)


def test_a_slow_move_on_a_key_that_waits_longer_is_no_swipe_either():
    hold = key(0, 1000, letter(A), hold=letter(C))
    desk = Desk(f"layer {letter(E)} {letter(F)}", hold, "swipe_ms 100", "tapping_term_ms 2000")
    desk.press(20, 30)
    desk.slide(20, 60, 400)
    desk.lift()
    assert desk.events == clicks(A)


# Behaviour 0: layer 1 for the next key.
STICKY_LAYER = f"behaviour 0 {STICKY} 0 {action(MOMENTARY, 1)}"


def layers(how):
    return Desk(
        STICKY_LAYER,
        "layer 0 0",
        key(0, 500, how),
        key(500, 1000, letter(A)),
        "layer 0 0",
        key(0, 500, action(TOGGLE, 1)),
        key(500, 1000, letter(B)),
    )


def test_a_layer_for_the_next_key():
    desk = layers(action(BEHAVIOUR, 0))
    for x_mm in (20, 80, 80):
        desk.tap(x_mm)
    assert desk.events == clicks(B, A)


def test_a_layer_that_stays_until_it_is_switched_off():
    desk = layers(action(TOGGLE, 1))
    for x_mm in (20, 80, 80, 20, 80):
        desk.tap(x_mm)
    assert desk.events == clicks(B, B, A)


def test_a_layer_while_its_key_is_held():
    desk = layers(action(MOMENTARY, 1))
    desk.press(20, 100)
    desk.press(80, 100)  # the next finger already touches when the first one lifts
    desk.lift()
    desk.tap(80)
    desk.tap(20)
    desk.tap(80)
    assert desk.events == clicks(B, A, A)


@pytest.mark.parametrize("flavor", [HOLD_PREFERRED, BALANCED, TAP_PREFERRED])
@pytest.mark.parametrize("held_ms", [100, 500])
def test_a_layer_while_a_key_is_held_that_also_has_a_tap(flavor, held_ms):
    desk = Desk(
        f"flavor {flavor}",
        "layer 0 0",
        key(0, 500, letter(C), hold=action(MOMENTARY, 1)),
        key(500, 1000, letter(A)),
        "layer 0 0",
        key(500, 1000, letter(B)),
    )
    desk.press(20, held_ms)
    desk.press(80, 100)
    desk.lift()
    desk.tap(80)
    is_hold = flavor == HOLD_PREFERRED or held_ms > 200
    assert desk.events == (clicks(B, A) if is_hold else [*rolled(C, A), *clicks(A)])


@pytest.mark.parametrize("how", [action(BEHAVIOUR, 0), action(TOGGLE, 1)])
def test_a_tap_that_waited_for_a_second_one_switches_the_layer_before_the_next_key(how):
    desk = Desk(
        STICKY_LAYER,
        "layer 0 0",
        key(0, 500, how, double=letter(C)),
        key(500, 1000, letter(A)),
        "layer 0 0",
        key(0, 500, letter(D)),
        key(500, 1000, letter(B)),
    )
    for x_mm in (20, 80, 80):
        desk.tap(x_mm)
    assert desk.events == clicks(B, A if how == action(BEHAVIOUR, 0) else B)


def test_a_swipe_is_that_of_the_layer_for_the_next_key():
    desk = Desk(
        STICKY_LAYER,
        f"layer {letter(E)} {letter(E)}",
        key(0, 500, action(BEHAVIOUR, 0)),
        key(500, 1000, letter(A)),
        f"layer 0 {letter(D)}",
        key(0, 1000, letter(B)),
    )
    desk.tap(20)
    desk.press(20, 20)
    desk.slide(20, 70, 100)
    desk.lift()
    desk.tap(80)
    assert desk.events == clicks(D, A)


def test_a_key_is_released_as_it_was_pressed_whatever_layer_is_on():
    desk = layers(action(TOGGLE, 1))
    desk.press(80)
    desk.pad.engine.layers.clear(2)
    desk.lift()
    assert desk.events == clicks(A)


def test_a_finger_that_lay_there_through_a_release_has_to_lift():
    desk = one(key(0, 1000, letter(A)))
    desk.press(50)
    desk.pad.release()
    desk.pad.release()
    desk.press(50, 500)
    assert desk.events == clicks(A)
    desk.lift()
    desk.press(50)
    assert desk.events[2:] == [(A, True)]


def test_a_release_forgets_a_tap_that_waits_and_the_layer():
    desk = one(DOUBLE)
    desk.tap(20)
    desk.pad.release()
    desk.lift(1000)
    assert desk.events == []
    desk = layers(action(TOGGLE, 1))
    desk.tap(20)
    desk.pad.release()
    desk.lift()
    desk.tap(80)
    assert desk.events == clicks(A)


EVERYTHING = (
    STICKY_LAYER,
    f"behaviour 1 {TAP_DANCE} 200 3 {letter(20)} {letter(21)} {action(BEHAVIOUR, 0)}",
    f"behaviour 2 {MOD_MORPH} 2 0 {letter(22)} {letter(23)}",
    f"behaviour 3 {KEY_REPEAT}",
    f"behaviour 4 {CAPS_WORD}" + " 131586" * CAPS_SIZE,
    f"behaviour 5 {STICKY} 500 {letter(SHIFT)}",
    f"behaviour 6 {HOLD_TAP} 3 100 150 50 {action(BEHAVIOUR, 5)}",
    f"layer {letter(A)} {letter(B)}",
    key(0, 200, letter(C), letter(D), letter(E), letter(F), letter(10), letter(11)),
    key(200, 400, letter(12), hold=action(MOMENTARY, 1)),
    key(450, 600, letter(13), double=action(BEHAVIOUR, 0)),
    key(600, 800, action(TOGGLE, 1)),
    key(800, 860, letter(14), firm=letter(15)),
    key(860, 900, action(BEHAVIOUR, 1), firm=action(BEHAVIOUR, 2)),
    key(900, 940, action(BEHAVIOUR, 3), hold=action(BEHAVIOUR, 6)),
    key(940, 1000, action(BEHAVIOUR, 2), double=action(BEHAVIOUR, 4), hold=action(BEHAVIOUR, 5)),
    "layer 0 0",
    key(0, 500, letter(16)),
    key(500, 1000, action(TOGGLE, 1), hold=letter(17), minus=letter(18), plus=letter(19)),
)


@pytest.mark.board
@given(
    flavor=st.integers(0, 3),
    readings=st.lists(
        st.tuples(
            st.sampled_from([1, 1, 1, 0, 4, 3, 17, 128, 129, 255]),
            st.integers(-(1 << 28), 1 << 28) | st.integers(0, LENGTH_UM),
            st.integers(0, 65_535),
            st.integers(1, 40),
        ),
        max_size=40,
    ),
)
def test_whatever_comes_no_key_is_doubled_or_stays_in_integers_of_31_bits(flavor, readings):
    desk = Desk(f"flavor {flavor}", "stuck_ms 900", *EVERYTHING, number=SmallInt)
    for flags, x_um, force_mN, times in readings:
        for _ in range(times):
            desk.read(flags, x_um, force_mN)
    desk.pad.release()
    down = set()
    for usage, pressed in desk.usages:
        assert (usage in down) != pressed
        down ^= {usage}
    assert not down


@st.composite
def taps(draw):
    """Return random taps on ten keys, as tuples of the values that are listed here."""
    hands = st.tuples(
        st.integers(0, 9),
        st.floats(0.12, 0.88),  # position on the key, as a share of its width
        st.integers(600, 9_000),  # force in mN
        st.integers(0, 3),  # readings while the force rises, and while it falls
        st.integers(3, 30),  # readings at full force
        st.integers(5, 60),  # readings until the next tap
        st.integers(-250, 250),  # position error of a single reading, um
        st.booleans(),  # whether the first reading, with little light, is untrusted
    )
    return draw(st.lists(hands, min_size=1, max_size=12))


@pytest.mark.board
@settings(max_examples=300)
@given(taps())
def test_whoever_taps_types_what_was_meant(hands):
    desk = Desk(*default_lines())
    for key_at, share, force_mN, ramp, held, gap, off_um, doubted in hands:
        x_um = round(10_000 * (key_at + share))
        for i in range(ramp):
            part = (i + 1) / (ramp + 1)
            touching = TOUCHING if force_mN * part >= 300 else 0
            doubt = MISFIT if doubted and i == 0 else 0
            desk.read(touching | doubt, x_um + off_um, round(force_mN * part))
        for i in range(held):
            desk.read(TOUCHING, x_um + off_um * (i % 3 - 1), force_mN)
        for i in range(ramp):
            desk.read(TOUCHING, x_um, round(force_mN * (ramp - i) / (ramp + 1)))
        desk.lift(10 * gap)
    assert desk.events == clicks(*(30 + hand[0] for hand in hands))


def test_a_key_long_after_its_last_tap_is_no_quick_one():
    hold = key(0, 500, letter(A), hold=letter(B))
    desk = Desk("slack_um 3000", "layer 0 0", hold, key(500, 1000, letter(C)))
    desk.tap(49.0)
    desk.lift(1_000)
    desk.now_ms += WRAP_MS - 1_000
    desk.press(51.0)
    assert desk.events == clicks(A) + [(C, True)]


def test_a_quick_tap_beside_a_key_is_the_next_key_unless_a_second_tap_has_a_meaning():
    desk = one(key(0, 500, letter(A)), key(500, 1000, letter(B)))
    desk.tap(49.0, 60, 60)
    desk.tap(50.3)
    assert desk.events == clicks(A, B)
    for actions in ({"hold": letter(C)}, {"double": letter(C)}):
        desk = one(key(0, 500, letter(A), **actions), key(500, 1000, letter(B)))
        desk.tap(49.0, 60, 60)
        desk.press(50.3)
        assert (B, True) not in desk.events


def test_the_slack_of_a_quick_second_tap_is_small_on_a_narrow_key():
    # A key of 3 mm, as on a strip of 30 mm.
    desk = one(key(0, 30, letter(A), hold=letter(C)), key(30, 60, letter(B)))
    desk.tap(2.9, 60, 60)
    desk.tap(3.3, 60, 60)
    assert desk.events == clicks(A, B)
    desk.lift(QUICK_MS)
    desk.tap(2.9, 60, 60)
    desk.tap(3.1, 60, 60)
    assert desk.events == clicks(A, B, A, A)


def test_a_swipe_long_after_the_finger_came_is_a_slide():
    slides = key(0, 1000, letter(A), minus=letter(B), plus=letter(C))
    lines = [
        "slide_um 5000",
        "swipe_um 6000",
        "jump_um 20000",
        f"layer {letter(E)} {letter(F)}",
        slides,
    ]
    desk = Desk(*lines)
    desk.press(20.0, 1_000)
    desk.now_ms += WRAP_MS - 900
    desk.press(28.0, 20)
    assert desk.events == clicks(C)


def test_an_interrupt_in_a_release_does_not_hide_that_a_key_is_down():
    desk = one(key(0, 1000, letter(A)))
    desk.press(20.0)

    def interrupted(*_):
        raise KeyboardInterrupt

    desk.usage = interrupted
    with pytest.raises(KeyboardInterrupt):
        desk.pad.release()
    del desk.usage
    desk.pad.release()
    desk.pad.release()
    assert desk.events == clicks(A)


THREE_KEYS = (
    "layer 0 0",
    key(0, 300, letter(A)),
    key(350, 650, letter(B)),
    key(700, 1000, letter(C)),
)


def two_fingers(*lines):
    """Return a `Desk` with a finger at 10 mm, and a second finger at 80 mm that presses a key."""
    desk = Desk(*lines)
    desk.press(10)
    assert desk.pad.second(80_000, 2_000, 0)
    desk.pad.engine.run()
    return desk


def test_two_fingers_hold_two_keys():
    desk = two_fingers(*THREE_KEYS)
    assert desk.events == [(A, True), (C, True)]
    desk.pad.left(True, 0)
    assert desk.events == [(A, True), *clicks(C)]
    desk.lift()
    assert desk.events == [(A, True), *clicks(C), (A, False)]


def test_the_key_of_the_second_finger_stays_down_when_the_first_leaves():
    desk = two_fingers(*THREE_KEYS)
    desk.pad.left(False, 0)
    assert desk.events == [(A, True), (C, True), (A, False)]
    desk.lift()
    assert desk.events == [(A, True), (C, True), (A, False), (C, False)]


@pytest.mark.parametrize("how", ["up", "release", "stuck"])
def test_both_keys_are_released_together(how):
    desk = two_fingers(*THREE_KEYS)
    if how == "up":
        desk.lift()
    else:
        getattr(desk.pad, how)()
    assert sorted(desk.events[2:]) == [(A, False), (C, False)]


def test_a_second_finger_near_a_border_or_on_the_same_key_presses_nothing():
    desk = Desk(*THREE_KEYS)
    desk.press(10)
    for x_um, slack_um in ((71_000, 1_500), (64_000, 1_500), (67_500, 100), (20_000, 1_000)):
        assert not desk.pad.second(x_um, slack_um, 0)
    assert desk.events == [(A, True)]


def test_a_second_finger_takes_the_layer_of_a_key_that_is_held():
    desk = layers(action(MOMENTARY, 1))
    desk.press(20)
    assert desk.pad.second(80_000, 2_000, 0)
    desk.pad.left(True, 0)
    assert desk.events == clicks(B)
    desk.lift()
    assert desk.events == clicks(B)
