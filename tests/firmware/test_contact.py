"""Readings become touches: noise causes no touch, and each finger causes one touch."""

import math

import pytest
from support import keys
from support.keys import DECAY, LENGTH_UM, Desk, clicks, key, letter, limit, rolled

from spots_device.fingers.contacts import (
    DOWN,
    NEVER_ALONE,
    PROVISIONAL,
    UP,
    Fingers,
)
from spots_device.keys.layout import default_lines, parse
from spots_device.reading.decode import (
    BRIGHTNESS,
    FORCE_MN,
    LED_OFF,
    MISFIT,
    POSITION_UM,
    SATURATED,
    TOO_DARK,
    TOUCHING,
)

A, B, C = 4, 5, 6
THREE = ("layer 0 0", key(0, 300, letter(A)), key(330, 660, letter(B)), key(700, 1000, letter(C)))


def test_a_press_is_believed_at_its_second_reading():
    desk = Desk(*THREE)
    desk.press(10, 10)
    assert desk.events == []
    desk.press(10, 10)
    assert desk.events == [(A, True)]
    desk.lift()
    assert desk.events == clicks(A)


def test_a_reading_too_weak_for_a_press_is_the_first_of_two():
    desk = Desk(*THREE)
    desk.press(10, 10, 250, flags=0)
    assert desk.events == []
    desk.press(10, 10)
    assert desk.events == [(A, True)]
    desk.lift()
    desk.press(80, 10, 250, flags=0)
    desk.press(10, 10)
    desk.lift()
    assert desk.events == clicks(A)


def test_one_reading_is_none_and_two_apart_are_none():
    desk = Desk(*THREE)
    desk.tap(10, 10)
    desk.press(10, 10)
    desk.press(80, 10)
    desk.lift()
    assert desk.events == []


def test_a_lift_is_believed_after_a_time_and_a_bounce_is_none():
    desk = Desk(*THREE, "release_ms 25")
    desk.press(10)
    desk.lift(20)
    desk.press(10, 30)
    assert desk.events == [(A, True)]
    desk.lift(20)
    assert desk.events == [(A, True)]
    desk.lift(10)
    assert desk.events == clicks(A)


def test_a_lift_lasts_since_the_last_reading_of_the_finger():
    # A reading measures the last 10 ms, so two readings without light are a lift of 20 ms.
    desk = Desk(*THREE, "release_ms 15")
    desk.press(10)
    desk.lift(10)
    assert desk.events == [(A, True)]
    desk.lift(10)
    desk.press(10)
    assert desk.events == [*clicks(A), (A, True)]


@pytest.mark.parametrize("doubt", [SATURATED, MISFIT, LED_OFF])
def test_a_doubtful_reading_neither_presses_nor_releases(doubt):
    desk = Desk(*THREE)
    desk.press(10, 200, flags=TOUCHING | doubt)
    assert desk.events == []
    desk.press(10)
    desk.press(80, 200, flags=TOUCHING | doubt)
    desk.press(10)
    assert desk.events == [(A, True)]
    desk.lift()
    assert desk.events == clicks(A)


def test_blindness_is_no_lift():
    desk = Desk(*THREE)
    desk.press(10)
    for _ in range(20):
        desk.read(LED_OFF | TOO_DARK)
    assert desk.events == [(A, True)]


def test_force_has_hysteresis():
    desk = Desk(*THREE, "press_mN 800", "release_mN 400")
    desk.press(10, 100, force_mN=799)
    assert desk.events == []
    desk.press(10, 20, force_mN=800)
    desk.press(10, 100, force_mN=400)
    assert desk.events == [(A, True)]
    desk.press(10, 100, force_mN=399)
    assert desk.events == clicks(A)


def test_a_finger_on_a_border_is_one_key():
    for layout in (THREE, ("layer 0 0", key(0, 330, letter(A)), key(330, 1000, letter(B)))):
        desk = Desk(*layout)
        for i in range(50):
            desk.press(33 + (-1) ** i * 0.1, 10)
        desk.lift()
        assert len(desk.events) == 2


def test_a_quick_second_tap_may_miss_its_key_by_a_little():
    desk = Desk(*THREE)
    slack_mm = limit("slack_um") / 1000
    desk.tap(32.9 + 0.2)
    desk.tap(33 - slack_mm + 0.1)
    desk.lift(1000)
    desk.tap(33 - slack_mm + 0.1)  # between the keys, so this is not a second tap
    assert desk.events == clicks(B, B)


def test_the_next_finger_counts_before_the_first_one_left():
    desk = Desk(*THREE)
    desk.press(10)
    desk.press(45, 50, flags=TOUCHING | MISFIT)
    desk.press(80, 10)
    assert desk.events == [(A, True)]
    desk.press(80, 10)
    assert desk.events == rolled(A, C)[:3]
    desk.lift()
    assert desk.events == rolled(A, C)


def test_a_finger_that_slides_is_the_same_one():
    desk = Desk(*THREE)
    desk.press(10)
    desk.slide(10, 90, 300)
    desk.lift()
    assert desk.events == clicks(A)


@pytest.mark.parametrize("moved_mm", [2.0, -3.5])
def test_a_finger_that_rolls_while_its_force_changes_is_one_key(moved_mm):
    # The new position and the lower force look as if a second finger had touched and then stayed.
    desk = Desk(*THREE)
    desk.press(10, 80, 2000)
    desk.press(10 + moved_mm, 60, 1000)
    desk.lift()
    assert desk.events == clicks(A)


@pytest.mark.parametrize("slid_mm", [4.0, -5.5])
def test_a_finger_that_slides_while_it_lifts_is_one_key(slid_mm):
    desk = Desk(*THREE)
    desk.press(27, 80, 2000)
    for share, force_mN in ((0.3, 1400), (0.6, 900), (0.85, 500), (1.0, 260)):
        desk.press(27 + slid_mm * share, 10, force_mN)
    desk.lift()
    assert desk.events == clicks(A)


def test_a_finger_nine_millimetres_from_the_one_that_lifts_is_another_key():
    desk = Desk(*THREE)
    desk.press(27, 80, 2000)
    for x_mm, force_mN in ((28, 2500), (33, 1600), (36, 1000)):
        desk.press(x_mm, 10, force_mN)
    desk.press(36, 60, 1000)
    desk.lift()
    assert desk.events == rolled(A, B)


def test_what_rests_for_long_is_no_finger():
    desk = Desk(*THREE, "stuck_ms 2000")
    desk.press(10, 1900)
    assert (desk.objects, desk.events) == (0, [(A, True)])
    desk.press(10, 200)
    assert (desk.objects, desk.events) == (1, clicks(A))
    assert not desk.pad.contact.touched
    desk.press(10, 1000)
    assert desk.events == clicks(A)
    desk.lift()
    desk.tap(80)
    assert desk.events == clicks(A, C)


def test_a_finger_that_moves_or_changes_its_force_does_not_rest():
    desk = Desk(*THREE, "stuck_ms 500")
    for i in range(20):
        desk.press(10 + 4 * (i % 2), 100)
    for i in range(20):
        desk.press(10, 100, force_mN=1000 + 600 * (i % 2))
    assert (desk.objects, desk.events) == (0, [(A, True)])


def test_without_a_limit_a_finger_may_rest():
    desk = Desk(*THREE, "stuck_ms 0")
    desk.press(10, 100_000)
    assert (desk.objects, desk.events) == (0, [(A, True)])


def blend(first, second):
    """Return the position in mm and the force in mN that a reading of two fingers has.

    `first` and `second` are (position in mm, force in mN). The equations are those of `second`.
    """
    (a_mm, a_mN), (b_mm, b_mN) = first, second
    nepers = DECAY / 2**24 * 1000 * math.log(2) * (b_mm - a_mm)
    share = 1 / (1 + a_mN / b_mN * math.exp(nepers))
    force_mN = (a_mN + b_mN) * math.exp(-0.39 * share * (1 - share) * nepers**2)
    return a_mm + share * (b_mm - a_mm), force_mN


def together(desk, first, second, milliseconds, flags=TOUCHING):
    """Press with two fingers (position in mm, force in mN) for a time; see `blend`."""
    x_mm, force_mN = blend(first, second)
    desk.press(x_mm, milliseconds, force_mN, flags)


ROLLED = [(A, True), (C, True), (A, False), (C, False)]


def rollover(desk, doubt=0):
    """Press with a second finger before the first one lifts; return the second position in mm.

    `doubt` are additional flags of the readings of both fingers.
    """
    # The spectrum of two fingers far from each other does not fit one press.
    a_mm, b_mm = (10, 80) if doubt else (28, 74)
    desk.press(a_mm, 60)
    for force_mN in (300, 800, 1000):
        together(desk, (a_mm, 1000), (b_mm, force_mN), 10, TOUCHING | doubt)
    together(desk, (a_mm, 1000), (b_mm, 1000), 20, TOUCHING | doubt)
    for force_mN in (900, 500, 100):
        together(desk, (a_mm, force_mN), (b_mm, 1000), 10, TOUCHING | doubt)
    return b_mm


@pytest.mark.parametrize("doubt", [0, MISFIT])
def test_of_two_fingers_no_key_between_them_is_pressed(doubt):
    desk = Desk(*THREE)
    second_mm = rollover(desk, doubt)
    assert desk.events == ROLLED[:2]
    assert desk.pad.contact.two
    desk.press(second_mm, 20)
    assert desk.events == ROLLED[:3]
    desk.lift()
    assert desk.events == ROLLED


def test_two_fingers_that_rest_are_two_keys_for_as_long_as_they_do():
    desk = Desk(*THREE)
    desk.press(28, 60)
    for force_mN in (300, 800, 1000):
        together(desk, (28, 1000), (74, force_mN), 10)
    together(desk, (28, 1000), (74, 1000), 3000)
    assert desk.events == ROLLED[:2]
    desk.lift()
    assert sorted(desk.events) == sorted(ROLLED)


def test_a_second_finger_is_found_while_the_force_of_the_first_one_was_never_seen_at_rest():
    desk = Desk(*THREE)
    desk.press(28, 10, 400)
    desk.press(28, 10, 800)
    for force_mN in (300, 700, 1000):
        together(desk, (28, 1200), (74, force_mN), 10)
    assert desk.events == ROLLED[:2]
    together(desk, (28, 1200), (74, 1000), 1000)
    desk.press(74, 20)
    assert desk.events == ROLLED[:3]


def test_a_light_that_changes_at_one_position_is_of_one_finger():
    desk = Desk(*THREE)
    desk.press(28, 60)
    together(desk, (28, 500), (74, 400), 10)
    desk.press(74, 10, 800)
    desk.press(74, 10, 1000)
    assert desk.events == rolled(A, C)[:3]


def test_of_two_known_fingers_one_reading_shows_which_one_left():
    desk = Desk(*THREE)
    desk.press(28, 60)
    for force_mN in (300, 800, 1000, 1000):
        together(desk, (28, 1000), (74, force_mN), 10)
    together(desk, (28, 400), (74, 1000), 10)
    desk.press(74, 10)
    assert desk.events == ROLLED[:3]


def test_a_third_finger_is_found_when_the_first_one_has_left():
    desk = Desk(*THREE)
    desk.press(20, 60)
    for force_mN in (300, 800, 1000, 1000):
        together(desk, (20, 1000), (48, force_mN), 10)
    for first_mN, third_mN in ((1000, 1000), (500, 1000)):
        together(desk, blend((20, first_mN), (48, 1000)), (82, third_mN), 10)
    assert desk.events == [(A, True), (B, True)]
    together(desk, (48, 1000), (82, 1000), 30)
    assert desk.events == [(A, True), (B, True), (A, False), (C, True)]
    desk.lift()
    assert sorted(desk.events[4:]) == [(B, False), (C, False)]


def test_one_reading_shows_a_finger_that_was_estimated_before():
    desk = Desk(*THREE)
    desk.press(28, 60)
    together(desk, (28, 1000), (74, 300), 10)
    together(desk, (28, 400), (74, 1000), 10)
    assert desk.events == [(A, True)]
    desk.press(74, 10)
    assert desk.events == rolled(A, C)[:3]
    desk.press(74, 10)
    together(desk, (74, 1000), (50, 300), 10)
    desk.press(74, 20)
    assert desk.events == rolled(A, C)[:3]


def test_two_estimates_agree_although_the_last_reading_has_hardly_more_light():
    desk = Desk(*THREE)
    desk.press(28, 10, 400)
    desk.press(28, 10, 800)
    for force_mN in (300, 700, 760):
        together(desk, (28, 1200), (74, force_mN), 10)
    assert desk.events == ROLLED[:2]


@pytest.mark.parametrize(("x_mm", "typed"), [(28, [(A, True)]), (31, [])])
def test_a_touch_in_doubt_is_one_finger_if_its_light_falls_where_it_was(x_mm, typed):
    desk = Desk(*THREE)
    desk.press(28, 100, 1000, TOUCHING | MISFIT)
    desk.press(x_mm, 10, 600)
    assert desk.events == typed


def three_fingers(desk):
    """Press at 38.5 mm and then also at 25.5 mm, while a first finger rests at 76 mm."""
    desk.press(76, 60)
    for force_mN in (300, 1200, 1600, 1600):
        together(desk, (76, 1000), (38.5, force_mN), 10)
    for force_mN in (300, 1000, 1500, 1500, 1500, 1500):
        together(desk, blend((76, 1000), (38.5, 1600)), (25.5, force_mN), 10)


def test_of_three_fingers_that_rest_none_has_left():
    desk = Desk(*THREE)
    three_fingers(desk)
    assert desk.events == [(C, True), (B, True), (B, False), *clicks(A)]


def test_a_third_finger_presses_its_key_again_when_it_comes_again():
    desk = Desk(*THREE)
    three_fingers(desk)
    desk.press(76, 30)
    desk.lift(10)
    desk.press(25.5, 20)
    assert desk.events[-3:] == [(A, False), (C, False), (A, True)]


def test_a_finger_that_begins_softly_on_a_weak_dye_is_one_finger():
    # The first, soft reading has an error of 1.1 mm: half the decay causes twice the noise.
    desk = Desk(*THREE, length_um=85_000, decay=DECAY // 2)
    desk.press(77.8, 10, 144, flags=0)
    desk.press(72.7, 10, 1050)
    desk.press(73.66, 10, 1700, flags=TOUCHING | MISFIT | TOO_DARK)
    desk.press(73.84, 10, 1725, flags=TOUCHING | MISFIT | TOO_DARK)
    desk.press(73.84, 40, 1725)
    desk.lift()
    assert desk.events == clicks(C)


def test_two_estimates_within_8_ms_do_not_confirm_each_other(monkeypatch):
    # While the first finger lifts and the second one arrives, two estimates can be equal by chance.
    monkeypatch.setattr(keys, "READING_MS", 5)
    desk = Desk(*THREE)
    desk.press(50, 60)
    for first_mN, second_mN in ((926, 301), (920, 424), (467, 473)):
        together(desk, (50, first_mN), (15, second_mN), 5)
    assert desk.events == [(B, True)]


def test_on_a_drifted_strip_no_key_between_two_fingers_is_pressed():
    # The spectrum of a single finger does not fit one press, but that of two fingers does.
    desk = Desk(*THREE)
    desk.press(85, 60, flags=TOUCHING | MISFIT | TOO_DARK)
    for force_mN in (400, 800, 1000):
        together(desk, (85, 1000), (15, force_mN), 10)
    together(desk, (85, 1000), (15, 1000), 60)
    assert desk.events == [(C, True), (A, True)]


def test_of_two_fingers_that_lift_at_once_no_key_between_them_is_pressed():
    desk = Desk(*THREE)
    desk.press(28, 60)
    for force_mN in (300, 800, 1000, 1000):
        together(desk, (28, 1000), (74, force_mN), 10)
    for share in (0.8, 0.4):
        together(desk, (28, 1000 * share), (74, 1000 * share), 10)
    desk.lift()
    assert sorted(desk.events) == sorted(ROLLED)


def change(desk, at_mm, *forces_mN):
    """Press with two fingers at the positions `at_mm`; each pair of forces in mN is a reading."""
    for first_mN, second_mN in forces_mN:
        together(desk, (at_mm[0], first_mN), (at_mm[1], second_mN), 10)


class Contacts:
    """Records CONTACT frames as (number of the finger, state, position in mm)."""

    def __init__(self, desk):
        self.sent = []
        self._fingers = Fingers(self)
        self._fingers.tracker.set_layout(parse(default_lines()), LENGTH_UM, DECAY)
        self._take = desk.pad.take
        desk.pad.take = self.take
        desk.lift(60)  # a new tracker ignores a finger that touches already

    def take(self, flags, x_um, force_mN, brightness, t):
        self._take(flags, x_um, force_mN, brightness, t)
        self._fingers.tracker.take(flags, x_um, force_mN, brightness, t)
        self._fingers.send(0, {POSITION_UM: x_um, FORCE_MN: force_mN, BRIGHTNESS: brightness})

    def contact(self, sensor, number, state, x_um, sigma_um, force_mN):
        self.sent.append((number, state, round(x_um / 1000)))


def test_a_finger_that_was_never_alone_leaves_no_contact_behind():
    desk = Desk(*THREE)
    contacts = Contacts(desk)
    desk.press(50, 60)
    change(desk, (50, 20), (1000, 400), (1000, 800), (1000, 1000), (1000, 1000))
    desk.press(50, 60)
    desk.lift()
    assert desk.events == [(B, True), (A, True), (A, False), (B, False)]
    of_second = [state for number, state, _ in contacts.sent if number == 2]
    assert of_second == [DOWN, *[PROVISIONAL] * (len(of_second) - 2), NEVER_ALONE]
    assert contacts.sent[-1] == (1, UP, 50)


def test_a_second_finger_that_leaves_first_leaves_the_key_of_the_first_down():
    desk = Desk(*THREE)
    desk.press(10, 60)
    for force_mN in (500, 1000, 1000, 400):
        together(desk, (10, 1000), (80, force_mN), 10)
    desk.press(10, 100)
    assert desk.events == [(A, True)]
    desk.lift()
    assert desk.events == clicks(A)


def test_fingers_that_came_together_press_nothing_until_one_is_alone():
    desk = Desk(*THREE)
    for force_mN in (400, 700, 1000, 800, 1200, 900, 1100):
        together(desk, (10, 1400 - force_mN // 2), (80, force_mN), 10)
    assert desk.events == []
    desk.press(80, 20, 900)
    assert desk.events == [(C, True)]


def test_fingers_that_leave_together_press_nothing():
    desk = Desk(*THREE)
    desk.press(10, 60)
    for force_mN in (300, 800, 1000, 900, 800):
        together(desk, (10, 1000), (80, force_mN), 10)
    desk.lift()
    assert desk.events == clicks(A)


def test_a_touch_that_lifts_for_one_reading_is_the_next_finger_where_it_returns():
    desk = Desk(*THREE)
    desk.press(10, 60)
    desk.lift(10)
    desk.press(80, 20)
    assert desk.events == [*clicks(A), (C, True)]


@pytest.mark.parametrize("at_mm", [(36, 6), (50, 10), (28, 74), (64, 36)])
def test_a_reading_without_touch_ends_a_finger_although_two_others_arrive(at_mm):
    desk = Desk(*THREE)
    desk.press(85, 60)
    desk.lift(10)
    change(desk, at_mm, (500, 50), (1500, 800), (2000, 1600), (2000, 2000))
    assert desk.events == clicks(C)


def test_an_ignored_touch_stays_ignored_although_one_reading_is_without_it():
    desk = Desk(*THREE)
    desk.press(80, 60)
    desk.pad.contact.spend()
    desk.lift(10)
    desk.press(10, 60)
    assert [event for event in desk.events if event[1]] == [(C, True)]


def test_readings_that_a_board_has_marked_give_the_same_keys():
    desk = Desk(*THREE)
    seen = []
    take = desk.pad.take

    def marked(flags, *reading):
        take(flags, *reading)
        two = flags & TOUCHING and desk.pad.contact.two
        mark = (MISFIT if flags & MISFIT else MISFIT | TOO_DARK) if two else 0
        seen.append((flags | mark, *reading))

    desk.pad.take = marked
    for doubt in (0, MISFIT):
        desk.press(rollover(desk, doubt), 40)
        desk.lift()
    again = Desk(*THREE)
    for reading in seen:
        again.pad.take(*reading)
        again.pad.tick(reading[-1])
    assert again.events == desk.events == ROLLED + ROLLED
