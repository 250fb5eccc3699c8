"""A touch ends when the finger leaves: sticking contact, lamps, objects, and presses that ease."""

import numpy as np
import pytest
from support.sensors import replaced

from spots.keyboard.key_engine import KeyEngine
from spots.keyboard.keys import push
from spots.keyboard.layout import load as load_layout
from spots.link.board import Board
from spots.link.connect import prepare
from spots.link.frames import Contact, Key, Touch
from spots_device.reading import decode
from spots_sim.board.lockstep import LockstepLink
from spots_sim.demo.demo import open_fast
from spots_sim.demo.demo_applications import type_on_board
from spots_sim.person.typist import fast_typing
from spots_sim.strip.files import Ambient, Finger, ScenarioFile
from spots_sim.strip.scenario import Scenario

pytestmark = pytest.mark.board
START_S = 3.0
DIGITS = "1234567890"


def sticking(sensor, percent, decay_s):
    """Return a sensor whose contact sticks."""
    return replaced(sensor, contact={"sticking_percent": percent, "sticking_s": decay_s})


def use(board, lines):
    """Use a calibration that was made with another board: that of the strip that does not stick."""
    own = f"board {board.info['id']}"
    prepare(board, [own if line.startswith("board ") else line for line in lines])


def press(x_mm, *points, start_s=START_S):
    """Return a finger at a position, from points (time in s after `start_s`, force in mN)."""
    return Finger(points=[(start_s + time_s, x_mm, force_mN) for time_s, force_mN in points])


class Events:
    """Key events of a board: (key, pressed, time in s); and its frames of fingers."""

    def __init__(self):
        self.keys, self.touches, self.contacts, self.here = [], [], [], []

    def key(self, page, usage, modifiers, pressed):
        self.here.append((DIGITS[usage - 30], pressed))

    @property
    def text(self):
        return "".join(key for key, pressed, _ in self.keys if pressed)


def play(sensor, lines, fingers, settings="", keys=True, stream="touch", after_s=1.0, **scenario):
    """Move fingers on a strip; return what the board has sent as `Events`."""
    end_s = max(finger.points[-1][0] for finger in fingers) + after_s
    file = ScenarioFile(seconds=end_s + 1, touch=fingers, **scenario)
    events = Events()
    with Board(LockstepLink(sensor, Scenario(file), seed=3)) as board:
        use(board, lines)
        if settings:
            board.command("set " + settings)
        if keys:
            layout = load_layout("digits")
            push(board, layout)
            info = board.command("hello")
            engine = KeyEngine(
                layout, info["length_um"], events, info["decay"], cross=info["cross"]
            )
        board.command("stream " + stream)
        for frame in board.frames(end_s - board.now_s()):
            if isinstance(frame, Key):
                events.keys.append((DIGITS[frame.usage - 30], frame.pressed, frame.time_s))
            elif isinstance(frame, Contact):
                events.contacts.append(frame)
            elif isinstance(frame, Touch):
                events.touches.append(frame)
                if keys:
                    engine.take(frame, board.now_s())
    if keys:
        assert [event[:2] for event in events.keys] == events.here
    return events


@pytest.mark.parametrize(("percent", "decay_s"), [(1.0, 0.3), (1.0, 1.0)])
def test_contact_that_sticks_types_as_contact_that_does_not(sensor, calibration, percent, decay_s):
    layout = load_layout("digits")
    file = fast_typing(layout, 60, 50, sensor.length_mm, 31)
    truth = Scenario(file)
    with Board(LockstepLink(sticking(sensor, percent, decay_s), truth, 31)) as board:
        use(board, calibration)
        run = type_on_board(board, truth, 0.0, file.seconds - board.now_s(), True, "digits")
    # Without the subtraction, there are 5 or more errors.
    assert run["right"] >= 49
    assert run["wrong"] + run["extra"] <= 1
    assert run["stuck"] == run["keys_down"] == 0
    assert run["host_agrees"]


@pytest.mark.parametrize(("percent", "decay_s"), [(1.0, 0.3), (1.0, 30.0)])
def test_positions_and_ends_of_touches_are_right_although_contact_sticks(
    sensor, calibration, percent, decay_s
):
    rng = np.random.default_rng(1)
    fingers, now_s = [], START_S
    for _ in range(8):
        held_s = rng.uniform(0.2, 0.6)
        points = (0, 0), (0.03, 3000), (held_s, 3000), (held_s + 0.03, 0)
        fingers.append(press(rng.uniform(5, 80), *points, start_s=now_s))
        now_s += held_s + rng.uniform(0.2, 0.5)
    events = play(sticking(sensor, percent, decay_s), calibration, fingers)
    assert len(events.text) == len(fingers)
    for finger in fingers:
        (began_s, x_mm, _), *_, (_, _, _), (ended_s, _, _) = finger.points
        read = [t for t in events.touches if began_s + 0.05 < t.time_s < ended_s - 0.04]
        assert abs(np.mean([t.position_um for t in read]) / 1000 - x_mm) < 0.2
        late = [t for t in events.touches if ended_s + 0.02 < t.time_s < ended_s + 0.16]
        assert not any(t.touching for t in late)
    last_s = {key: time_s for key, _, time_s in events.keys}
    assert max(last_s.values()) < fingers[-1].points[-1][0] + 0.1


def tap(x_mm, began_s, ended_s, force_mN):
    """Return a finger that touches between two times, in s after `START_S`."""
    points = (began_s, 0), (began_s + 0.018, force_mN), (ended_s - 0.02, force_mN), (ended_s, 0)
    return press(x_mm, *points)


@pytest.mark.parametrize("phase_s", [0.0, 0.004])
def test_the_light_of_a_finger_that_arrives_does_not_stick(sensor, calibration, phase_s):
    """The second finger begins in the only reading in which no finger touches."""
    first = tap(74.0, phase_s, phase_s + 0.146, 1900)
    second = tap(4.6, phase_s + 0.156, phase_s + 0.263, 2550)
    third = tap(64.4, phase_s + 0.225, phase_s + 0.389, 1200)
    events = play(sensor, calibration, [first, second, third])
    assert events.text == "918"
    # When the third finger is alone, its position is right.
    alone_s = START_S + phase_s + 0.28, START_S + phase_s + 0.36
    places = [t.position_um / 1000 for t in events.touches if alone_s[0] < t.time_s < alone_s[1]]
    assert places == pytest.approx([64.4] * len(places), abs=0.4)


@pytest.mark.parametrize(("percent", "decay_s"), [(0.0, 1.0), (1.0, 30.0)])
def test_a_finger_that_eases_keeps_its_key(sensor, calibration, percent, decay_s):
    eased = press(40, (0, 0), (0.03, 6000), (0.4, 6000), (0.5, 500), (2.0, 500), (2.03, 0))
    events = play(sticking(sensor, percent, decay_s), calibration, [eased])
    (_, _, pressed_s), (_, _, released_s) = events.keys
    assert released_s - pressed_s > 1.9


@pytest.mark.parametrize(
    ("percent", "force_mN", "paused_s"), [(0.0, 6000, 0.9), (1.0, 2000, 0.1), (1.0, 6000, 0.9)]
)
def test_a_finger_that_almost_lifts_and_presses_again_loses_no_key(
    sensor, calibration, percent, force_mN, paused_s
):
    points = [(0, 0)]
    for _ in range(3):
        now_s = points[-1][0]
        points += [(now_s + 0.03, force_mN), (now_s + 0.2, force_mN), (now_s + 0.23, 250)]
        points += [(now_s + 0.23 + paused_s, 250)]
    points[-1] = (points[-1][0], 0)
    events = play(sticking(sensor, percent, 1.0), calibration, [press(40, *points)])
    assert events.text == "555"


@pytest.mark.parametrize("light", [8, 120])
def test_a_lamp_that_is_switched_on_under_a_finger_presses_no_key(sensor, calibration, light):
    for i, x_mm in enumerate((7, 33, 55, 72)):
        held = press(x_mm, (0, 0), (0.03, 2000), (0.5, 2000), (0.53, 0))
        lamp = Ambient(steps=[(0, 0), (START_S + 0.15 + 0.1 * i, light)])
        events = play(sensor, calibration, [held], ambient=lamp)
        assert len(events.text) == 1
        assert events.keys[-1][2] < START_S + 0.53 + 0.1


def test_presses_beyond_the_calibrated_range_are_untrusted_but_typed(sensor, calibration):
    events = play(
        sensor, calibration, [press(40, (0, 0), (0.02, 60_000), (0.5, 60_000), (0.52, 0))]
    )
    firm = [t for t in events.touches if START_S + 0.05 < t.time_s < START_S + 0.48]
    assert firm
    assert all(t.touching and not t.trusted for t in firm)
    assert not any(t.flags & decode.MISFIT for t in firm)
    assert events.text == "5"


def test_positions_at_the_end_of_a_strip_that_is_stretched_too_far_are_untrusted(
    sensor, calibration
):
    for x_mm, trusted in ((40, True), (95, False)):
        held = press(x_mm, (0, 0), (0.02, 3000), (0.5, 3000), (0.52, 0))
        events = play(sensor, calibration, [held], keys=False, strain=[(0, 0.15)])
        read = [t for t in events.touches if START_S + 0.05 < t.time_s < START_S + 0.48]
        assert {t.trusted for t in read} == {trusted}


def test_a_reading_with_the_led_off_has_no_touch(sensor, calibration):
    held = press(40, (0, 0), (0.02, 3000), (1.0, 3000), (1.02, 0))
    events = play(sensor, calibration, [held], "dark_every=10")
    off = [t for t in events.touches if t.flags & decode.LED_OFF and t.time_s > START_S]
    assert len(off) > 5
    assert not any(t.touching for t in off)
    assert events.text == "5"


def test_an_object_is_released_after_half_a_minute_with_keys_only(sensor, calibration):
    lies = press(40, (0, 0), (0.1, 3000), (40.0, 3000), (40.1, 0))
    (_, _, pressed_s), (_, pressed, released_s) = play(sensor, calibration, [lies]).keys
    assert not pressed
    assert 29.9 < released_s - pressed_s < 30.2
    events = play(sensor, calibration, [lies], keys=False, stream="touch contact")
    held = [t for t in events.touches if START_S + 0.2 < t.time_s < START_S + 39.9]
    assert all(abs(t.force_mN - 3000) < 60 for t in held if not t.flags & decode.LED_OFF)
    assert len({contact.id for contact in events.contacts}) == 1


@pytest.mark.parametrize(("x_mm", "light"), [(7, 120), (55, 20)])
def test_a_lamp_under_a_finger_types_nothing_if_the_led_is_always_on(x_mm, light):
    held = press(x_mm, (0, 0), (0.03, 2000), (0.5, 2000), (0.53, 0))
    lamp = Ambient(steps=[(0, 0), (START_S + 0.2, light)])
    file = ScenarioFile(seconds=START_S + 2, touch=[held], ambient=lamp)
    board, _ = open_fast("always", Scenario(file), 3)
    with board:
        push(board, load_layout("digits"))
        board.command("stream touch")
        frames = list(board.frames(file.seconds - board.now_s()))
    keys = [frame for frame in frames if isinstance(frame, Key)]
    assert [key.pressed for key in keys] == [True, False]
    assert keys[1].time_s < START_S + 0.53 + 0.1
