"""CONTACT frames, one for each finger and reading, of a virtual board with up to two fingers."""

import math
import random
from itertools import groupby, pairwise
from statistics import fmean

import pytest

from spots.advice.contact_finder import ContactFinder
from spots.keyboard.layout import load
from spots.link.connect import upload_lines
from spots.link.frames import Contact, Key, Touch
from spots_device.fingers.contacts import (
    CONFIRMED,
    DOWN,
    NEVER_ALONE,
    PROVISIONAL,
    UP,
)
from spots_device.keys.layout import action
from spots_device.reading.decode import LED_OFF, MISFIT, TOUCHING
from spots_device.usb.usages import KEYBOARD
from spots_sim.demo.demo import open_fast
from spots_sim.person.typist import fast_typing, two_fingers
from spots_sim.strip.files import Ambient, Finger, ScenarioFile
from spots_sim.strip.scenario import Scenario

LENGTH_UM = 85_000
A = action(KEYBOARD, 4)


def finger(x_mm, begins_s, ends_s, force_mN=2000):
    points = [(begins_s, 0), (begins_s + 0.02, force_mN), (ends_s - 0.02, force_mN), (ends_s, 0)]
    return Finger(points=[(3.0 + time_s, x_mm, force) for time_s, force in points])


ROLLED = finger(30, 0.0, 1.0), finger(62, 0.5, 1.5)
RESTED = finger(30, 0.0, 1.5), finger(62, 0.5, 1.0)


@pytest.fixture
def played():
    """Return a function that moves fingers on a strip; it returns the board and all its frames."""
    boards = []

    def play(*fingers, command=None, layout=None):
        seconds = max(one.points[-1][0] for one in fingers) + 0.5
        truth = Scenario(ScenarioFile(seconds=seconds, touch=list(fingers)))
        board, _ = open_fast("default", truth, 5)
        boards.append(board)
        if layout:
            upload_lines(board, "layout", layout)
        if command:
            board.command(command)
        board.contacts()
        return board, list(board.frames(seconds - board.now_s()))

    yield play
    for board in boards:
        board.close()


def contacts(frames):
    """Return the CONTACT frames in `frames`, as a dict of lists by number of the finger."""
    found = {}
    for frame in frames:
        if isinstance(frame, Contact):
            found.setdefault(frame.id, []).append(frame)
    return found


def states(finger):
    return [state for state, _ in groupby(contact.state for contact in finger)]


@pytest.mark.board
@pytest.mark.parametrize("command", [None, "set keys=1"])
def test_fingers_that_roll_come_and_go_once(played, command):
    _, frames = played(*ROLLED, command=command)
    found = contacts(frames)
    assert list(found) == [1, 2]
    assert states(found[1]) == [DOWN, CONFIRMED, PROVISIONAL, UP]
    # The finger is provisional at its end, too, because a lift may be short.
    assert states(found[2]) == [DOWN, PROVISIONAL, CONFIRMED, PROVISIONAL, UP]
    for one, x_mm in zip(found.values(), (30, 62)):
        assert [contact.state for contact in one].count(DOWN) == 1
        assert [contact.ended for contact in one].count(True) == 1
        off_mm = [contact.position_um / 1000 - x_mm for contact in one]
        assert max(map(abs, off_mm)) < 3
        assert all(0 < contact.sigma_um < 3000 for contact in one)


@pytest.mark.board
def test_a_finger_beside_a_resting_one_was_never_alone(played):
    _, frames = played(*RESTED)
    found = contacts(frames)
    assert states(found[1]) == [DOWN, CONFIRMED, PROVISIONAL, CONFIRMED, PROVISIONAL, UP]
    assert states(found[2]) == [DOWN, PROVISIONAL, NEVER_ALONE]
    assert abs(found[2][-1].position_um / 1000 - 62) < 3


@pytest.mark.board
@pytest.mark.parametrize("pairs", [False, True], ids=["typing", "pairs"])
def test_contacts_are_the_same_with_keys_and_without(played, pairs):
    layout = load("digits")
    # The borders of the board's keys are where the fingers touch, so many keys are uncertain.
    bounds = [0, *range(50, 1000, 100), 1000]
    keys = [f"key {low} {high} {A} 0 0 0 0 0" for low, high in pairwise(bounds)]
    if pairs:
        file = two_fingers(layout, 24, LENGTH_UM / 1000, 11)
    else:
        file = fast_typing(layout, 100.0, 40, LENGTH_UM / 1000, 11)
    sent = []
    for on in (1, 0):
        _, frames = played(*file.touch, command=f"set keys={on}", layout=["layer 0 0", *keys])
        sent.append([shown(frame) for frame in frames if isinstance(frame, Contact)])
        assert (sum(isinstance(frame, Key) for frame in frames) > 40) == on
    assert len(sent[0]) > 300
    assert sent[0] == sent[1]


def shown(contact):
    """Return all values of a contact but its sequence number, which counts the KEY frames, too."""
    return repr(contact._replace(sequence=0, time_s=0.0))


def sliding(x1_mm, from_mm, to_mm, mm_per_s, wobble=0.0, seed=0):
    """Return a resting finger, a sliding finger, and the sliding finger's position over time.

    Parameters
    ----------
    x1_mm : float
        Position of the resting finger.
    from_mm, to_mm, mm_per_s : float
        Start, end and speed of the slide.
    wobble : float
        Largest relative change of the sliding finger's force; a tenth of it for the other finger.
    seed : int
        Random seed of the forces.

    Returns
    -------
    first, second : Finger
    at_mm : callable
        ``at_mm(time_s)`` returns the position of the second finger.
    """
    rng = random.Random(seed)
    ends_s = 0.5 + abs(to_mm - from_mm) / mm_per_s

    def path(begins_s, ends_s, at_mm, wobble):
        inner = range(round(20 * begins_s) + 1, round(20 * ends_s))
        points = [(i / 20, at_mm(i / 20), 3000 * (1 + rng.uniform(-wobble, wobble))) for i in inner]
        ramps = [(begins_s, at_mm(begins_s), 0), (ends_s, at_mm(ends_s), 0)]
        return Finger(points=[(3 + t, x, f) for t, x, f in [ramps[0], *points, ramps[1]]])

    def at_mm(time_s):
        share = (time_s - 0.5) * mm_per_s / abs(to_mm - from_mm)
        return from_mm + min(max(share, 0.0), 1.0) * (to_mm - from_mm)

    first = path(0.0, ends_s + 0.4, lambda _: x1_mm, wobble / 10)
    return first, path(0.3, ends_s + 0.2, at_mm, wobble), lambda t: at_mm(t - 3.0)


SLIDES = (12, 70, 35), (30, 50, 75), (60, 15, 45), (60, 40, 15), (75, 50, 20), (45, 20, 5)


@pytest.mark.board
@pytest.mark.parametrize(("mm_per_s", "wobble"), [(20, 0.0), (100, 0.1)])
def test_a_second_finger_is_followed_while_the_first_one_rests(played, mm_per_s, wobble):
    off, shares = [], []
    for seed, (x1_mm, from_mm, to_mm) in enumerate(SLIDES):
        first, second, at_mm = sliding(x1_mm, from_mm, to_mm, mm_per_s, wobble, seed)
        _, frames = played(first, second)
        found = contacts(frames)
        assert len(found) == 2
        assert states(found[1])[-3:] == [CONFIRMED, PROVISIONAL, UP]  # it touched until the end
        both = [c for c in found[2] if c.state == PROVISIONAL and c.time_s < second.points[-2][0]]
        errors_mm = [c.position_um / 1000 - at_mm(c.time_s) for c in both]
        off += errors_mm
        shares += [error * 1000 / c.sigma_um for error, c in zip(errors_mm, both)]
    assert max(map(abs, off)) < 3
    assert math.sqrt(fmean(x * x for x in off)) < 0.5
    assert math.sqrt(fmean(x * x for x in shares)) < 1


@pytest.mark.board
def test_a_force_is_known_only_of_a_finger_alone(played):
    _, frames = played(*ROLLED)
    for one in contacts(frames).values():
        for contact in one:
            if contact.state in (PROVISIONAL, UP):
                assert math.isnan(contact.force_mN)
            elif contact.state == CONFIRMED:
                assert contact.force_mN > 100
    assert contacts(frames)[1][0].force_mN > 100


def test_a_contact_has_the_time_of_its_reading_and_a_blend_is_untrusted(played):
    _, frames = played(*ROLLED)
    readings = {frame.t_us: frame for frame in frames if isinstance(frame, Touch)}
    both = [frame for frame in frames if isinstance(frame, Contact) and frame.id == 2]
    assert all(frame.t_us in readings for frame in frames if isinstance(frame, Contact))
    blends = [readings[frame.t_us] for frame in both if frame.state == PROVISIONAL]
    assert len(blends) > 10
    assert all(blend.flags & MISFIT or not blend.flags & TOUCHING for blend in blends)


@pytest.mark.board
def test_no_key_is_typed_without_keys(played):
    _, frames = played(*ROLLED)
    assert not any(isinstance(frame, Key) for frame in frames)


@pytest.mark.board
@pytest.mark.parametrize("fingers", [ROLLED, RESTED])
def test_the_host_finds_the_same_contacts_from_the_readings(played, fingers):
    board, frames = played(*fingers)
    finder = ContactFinder(LENGTH_UM, board.info["decay"])
    made = [one for frame in frames if isinstance(frame, Touch) for one in finder.take(frame)]
    there = [frame for frame in frames if isinstance(frame, Contact)]
    assert [repr(one[2:]) for one in there] == [repr(one[2:]) for one in made] != []


@pytest.mark.board
@pytest.mark.parametrize(("fingers", "ends"), [(ROLLED, [4, 8]), (RESTED, [8, 4])])
def test_contacts_and_keys_do_not_change_while_the_led_is_off(played, fingers, ends):
    # Dark frames while one finger touches, while two touch, and at other times.
    _, frames = played(*fingers, command="set keys=1 dark_every=100")
    dark = {frame.t_us for frame in frames if isinstance(frame, Touch) and frame.flags & LED_OFF}
    assert len(dark) >= 6
    found = contacts(frames)
    assert list(found) == [1, 2]
    frozen = 0
    for one in found.values():
        for before, contact in zip(one, one[1:]):
            if contact.t_us in dark:
                assert contact.state == PROVISIONAL
                assert contact.position_um == before.position_um
                frozen += 1
    assert frozen >= 6
    keys = [(frame.usage - 29, frame.pressed) for frame in frames if isinstance(frame, Key)]
    assert keys == [(4, True), (8, True), *((key, False) for key in ends)]


@pytest.mark.board
def test_a_new_dark_frame_ends_the_doubt_about_a_second_finger(rig, calibration):
    made = rig(calibration=calibration)
    stream = made.board.contacts(10.0)
    made.settle(2.5)
    made.press(42.5, 4000)
    made.settle()
    steps = [(0.0, 3.0)]
    lamp = Scenario(ScenarioFile(seconds=1e6, ambient=Ambient(steps=steps)))
    made.held.ambient_uW_cm2 = lamp.ambient_uW_cm2
    made.settle(4.0)
    seen = list(unread(stream))
    assert {contact.id for contact in seen} == {1}
    # After a change of the light dark samples are frequent, and each raises a short doubt.
    assert states(seen)[:3] == [DOWN, CONFIRMED, PROVISIONAL]
    assert sum(contact.state == CONFIRMED for contact in seen[-100:]) > 80
    assert sum(contact.state == PROVISIONAL for contact in seen) < 300
    assert abs(seen[-1].position_um / 1000 - 42.5) < 0.5


def test_a_new_setting_ends_a_finger_that_is_down(rig, calibration):
    made = rig(calibration=calibration)
    stream = made.board.contacts(10.0)
    made.settle()
    made.press(40, 3000)
    assert [next(stream).state for _ in range(3)] == [DOWN, CONFIRMED, CONFIRMED]
    made.board.set(average=2)
    made.settle()
    assert [contact.state for contact in unread(stream)][-1] == UP
    made.release()
    made.settle()
    made.press(40, 3000)
    assert next(stream).state == DOWN


def unread(stream):
    while stream.unread:
        yield next(stream)


def test_a_stream_that_begins_during_a_touch_leaves_the_key_down(rig, calibration):
    made = rig(calibration=calibration)
    made.board.command("set keys=1")
    keys = made.board.keys(3.0)
    made.settle()
    made.press(40, 3000)
    assert next(keys).pressed
    stream = made.board.contacts(10.0)
    assert [next(stream).state for _ in range(3)] == [DOWN, CONFIRMED, CONFIRMED]
    made.board.command("stream touch")
    made.settle()
    list(unread(stream))
    made.release()
    frames = list(made.board.frames(0.3))
    assert [frame.pressed for frame in frames if isinstance(frame, Key)] == [False]
    assert not any(isinstance(frame, Contact) for frame in frames)


def test_a_stream_that_begins_during_a_touch_has_this_finger_without_keys_too(rig, calibration):
    made = rig(calibration=calibration)
    made.settle()
    made.press(40, 3000)
    made.settle()
    stream = made.board.contacts(10.0)
    assert [next(stream).state for _ in range(3)] == [DOWN, CONFIRMED, CONFIRMED]


def test_contacts_end_nobody_elses_stream(rig, calibration):
    made = rig(calibration=calibration)
    made.board.spectra()
    made.board.contacts()
    assert made.board.command("sync")["stream"] == ["contact", "spectrum", "touch"]


def test_without_a_calibration_a_note_says_that_no_contact_comes(rig):
    made = rig()
    reply = made.board.command("stream contact touch")
    assert reply["note"] == "without a calibration there are no contacts"
    assert "note" not in made.board.command("stream touch")
