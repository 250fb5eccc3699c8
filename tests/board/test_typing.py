"""Typing on a board that is a keyboard: each key is right, not repeated, and then released.

In each test, the key engine also runs on the host with the same readings, and must give the same
events.
"""

from dataclasses import dataclass

import numpy as np
import pytest

from spots.calibrate.fit.fit import fit
from spots.calibrate.fit.presses import Noise
from spots.keyboard.key_engine import KeyEngine
from spots.keyboard.keys import push
from spots.keyboard.layout import load
from spots.link.board import Board
from spots.link.connect import prepare
from spots.link.frames import Key, Touch
from spots.outputs.usages import KEYBOARD
from spots_sim.board.lockstep import LockstepLink
from spots_sim.person.stage import Stage
from spots_sim.person.typist import TypedText, Typist
from spots_sim.strip.files import Ambient, Finger, ScenarioFile
from spots_sim.strip.scenario import Scenario

pytestmark = pytest.mark.board

START_S = 3.0
SETTLED_S = 0.6
DIGITS = "1234567890"
STRAIN = 0.15
TAPS = 300


class Events:
    def __init__(self):
        self.events = []

    def key(self, *event):
        self.events.append(event)


@dataclass
class Typed:
    """Result of a run: typed text, key events with their times, and readings."""

    text: str
    presses_s: list[float]
    presses: int
    touches: list[Touch]


@pytest.fixture(scope="module")
def play(sensor, calibration):
    """Return a function that moves fingers on a keyboard; it returns the result as `Typed`."""

    def run(fingers, layout="digits", lines=calibration, settings="", agrees=True, **scenario):
        end_s = max(finger.points[-1][0] for finger in fingers) + SETTLED_S
        file = ScenarioFile(seconds=end_s + 1, touch=fingers, **scenario)
        typed, there, here = TypedText(), Events(), Events()
        presses_s, touches = [], []
        with Board(LockstepLink(sensor, Scenario(file), seed=1)) as board:
            prepare(board, lines)
            if settings:
                board.command("set " + settings)
            chosen = load(layout)
            push(board, chosen)
            info = board.command("hello")
            engine = KeyEngine(chosen, info["length_um"], here, info["decay"], cross=info["cross"])
            board.command("stream touch")
            assert board.now_s() < min(finger.points[0][0] for finger in fingers)
            for frame in board.frames(end_s - board.now_s()):
                if isinstance(frame, Touch):
                    touches.append(frame)
                    engine.take(frame, board.now_s())
                elif isinstance(frame, Key):
                    there.key(*frame[3:7])
                    typed.key(*frame[3:7])
                    if frame.pressed:
                        presses_s.append(frame.time_s)
        assert not agrees or here.events == there.events
        assert not typed.down
        return Typed(typed.text, presses_s, typed.presses, touches)

    return run


def typist(seed, layout="digits", length_mm=85.0, **options):
    rng = np.random.default_rng(seed)
    return Typist(load(layout), length_mm, rng, start_s=START_S, **options)


def at(key):
    """Return the middle of one of the ten keys, in mm."""
    return 8.5 * (DIGITS.index(key) + 0.5)


def finger(*points, start_s=START_S):
    """Return a finger from points (time in s after `start_s`, position in mm, force in mN)."""
    return Finger(points=[(start_s + time_s, x_mm, force) for time_s, x_mm, force in points])


def tapped(x_mm, start_s, held_s=0.1, rise_s=0.02, force_mN=1500, slip_mm=0.0):
    return finger(
        (0, x_mm, 0),
        (rise_s, x_mm, force_mN),
        (rise_s + held_s, x_mm + slip_mm, force_mN),
        (2 * rise_s + held_s, x_mm + slip_mm, 0),
        start_s=start_s,
    )


def test_random_taps_on_ten_keys(play):
    """All taps are right, none is repeated or stuck; most need two samples."""
    somebody = typist(5, pause_s=(0.08, 0.2))
    text = "".join(np.random.default_rng(6).choice(list(DIGITS), TAPS))
    somebody.type(text)
    typed = play(somebody.touches)
    assert typed.presses == len(typed.text) == len(text)
    right = sum(wanted == got for wanted, got in zip(text, typed.text))
    began_s = np.array([touch.points[0][0] for touch in somebody.touches])
    late_ms = 1000 * (np.array(typed.presses_s) - began_s)
    seen_s = np.array([touch.time_s for touch in typed.touches if touch.touching])
    # Number of readings of the touch, up to the reading that caused the key press.
    samples = np.searchsorted(seen_s, np.array(typed.presses_s) + 1e-4) - np.searchsorted(
        seen_s, began_s
    )
    print(
        f"{right} of {TAPS} right; a key comes with reading {samples.max()} of its touch at the "
        f"latest; {np.median(late_ms):.1f} ms after the first contact in the median, "
        f"{late_ms.max():.1f} ms at most, at 10 ms an exposure and 20 ms to full force"
    )
    assert right == TAPS
    # One finger in fifteen looks like two in its second sample; then a third one decides.
    assert np.mean(samples > 2) < 0.08
    assert np.mean(samples > 3) < 0.015
    assert late_ms[samples <= 2].max() < 30
    assert late_ms.max() < 50


PEOPLE = {
    "slow": {"held_s": 0.6, "rise_s": 0.25, "pause_s": 0.5},
    "fast": {"held_s": 0.03, "rise_s": 0.015, "pause_s": 0.06},
    "sloppy": {"held_s": 0.12, "slip_mm": 2.5, "pause_s": 0.15},
    "light": {"force_mN": 500, "pause_s": 0.15},
    "heavy": {"force_mN": 9500, "rise_s": 0.04, "pause_s": 0.15},
}


@pytest.mark.parametrize("who", PEOPLE)
def test_people_differ_and_are_understood(play, who):
    how = dict(PEOPLE[who])
    pause_s = how.pop("pause_s")
    slip_mm = how.pop("slip_mm", 0.0)
    fingers, now_s, text = [], START_S, "3141592653589793238462643383279"
    for i, key in enumerate(text):
        way_mm = slip_mm if i % 2 else -slip_mm
        fingers.append(tapped(at(key), now_s, slip_mm=way_mm, **how))
        now_s = fingers[-1].points[-1][0] + pause_s
    assert play(fingers).text == text


def test_a_second_finger_far_from_the_first_is_the_next_key(play):
    fingers = [
        finger((0, at("2"), 0), (0.02, at("2"), 1500), (0.3, at("2"), 1500), (0.32, at("2"), 0)),
        finger((0.2, at("8"), 0), (0.22, at("8"), 1500), (0.6, at("8"), 1500), (0.62, at("8"), 0)),
    ]
    assert play(fingers).text == "28"


def test_a_finger_that_slides_over_the_strip_is_the_key_where_it_began(play):
    slid = finger((0, at("3"), 0), (0.02, at("3"), 1500), (0.8, at("9"), 1500), (0.82, at("9"), 0))
    assert play([slid]).text == "3"


def test_a_finger_on_a_border_is_one_of_its_two_keys(play):
    fingers = []
    for i in range(9):
        edge_mm = 8.5 * (i + 1)
        trembling = [(0.05 * k, edge_mm + 0.3 * (-1) ** k, 1500) for k in range(1, 20)]
        points = [(0, edge_mm, 0), *trembling, (1.0, edge_mm, 0)]
        fingers.append(finger(*points, start_s=START_S + 1.3 * i))
    # The host has only position and force of the readings; the board also uses the spectra.
    text = play(fingers, agrees=False).text
    assert len(text) == 9
    for i, key in enumerate(text):
        assert key in DIGITS[i : i + 2]


@pytest.fixture(scope="module")
def stretched(sensor):
    """Lines of a calibration with tables for the unstretched and for the stretched strip."""
    with Stage(sensor) as stage:
        stage.expose()
        along, pressed = stage.along(), stage.pressed()
        stage.held.strain = STRAIN
        strained = stage.along()
        ppm = round(1e6 * STRAIN)
        noise = Noise.of(along, pressed)
        return tuple(fit({0: along, ppm: strained}, pressed, noise, stage.reader.conditions))


def test_on_a_strip_that_is_stretched(play, stretched):
    somebody = typist(7, length_mm=85.0 * (1 + STRAIN))
    text = "".join(np.random.default_rng(8).choice(list(DIGITS), 40))
    somebody.type(text)
    settings = f"strain_ppm={round(1e6 * STRAIN)}"
    typed = play(somebody.touches, lines=stretched, settings=settings, strain_percent=100 * STRAIN)
    assert typed.text == text


@pytest.mark.parametrize("level_uW_cm2", [0.02, 2.0])
def test_a_lamp_that_is_switched_on_types_nothing_and_stops_nobody_for_long(play, level_uW_cm2):
    before, after = typist(9), typist(10)
    before.type("123")
    after.seconds = before.seconds + 4.0
    lamp_s = before.seconds + 0.5
    after.type("4567890")
    ambient = Ambient(steps=[(lamp_s, level_uW_cm2)], flicker_percent=30, flicker_hz=100)
    assert play(before.touches + after.touches, ambient=ambient).text == "1234567890"


def test_letters_by_firm_presses_holds_and_a_layer(play):
    somebody = typist(11, "mini")
    text = "pack my box, type 90!\n"
    somebody.type(text)
    assert play(somebody.touches, "mini").text == text


def test_a_key_with_a_modifier_appears_by_what_its_caps_say():
    typed = TypedText()
    typed.key(KEYBOARD, 6, 0x41, True)
    typed.key(KEYBOARD, 6, 0x02, True)
    assert typed.text == "<Ctrl+AltGr+C>C"
