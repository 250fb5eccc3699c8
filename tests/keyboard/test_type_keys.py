"""Programs that press keys on this computer: no key stays pressed, on every exit path."""

import json
from contextlib import nullcontext
from types import SimpleNamespace

import numpy as np
import pytest
from support.refusals import refusal

from spots import cli
from spots.errors import BoardError, RequirementError, SpotsError
from spots.keyboard.key_engine import KeyEngine
from spots.keyboard.keyboard import type_on
from spots.keyboard.keys import push
from spots.keyboard.layout import load
from spots.link.board import Board
from spots.link.connect import prepare
from spots.link.frames import Touch
from spots.link.readers import FrameIterator
from spots.link.timeouts import RELEASE_S
from spots.outputs.devices import Keyboard
from spots.wearable import gestures as g
from spots.wearable.wearable import DEFAULT, Mapping, play
from spots_device.reading.decode import LED_OFF
from spots_sim.board.lockstep import LockstepLink
from spots_sim.person.typist import TypedText, Typist, typing
from spots_sim.strip.files import Finger, ScenarioFile
from spots_sim.strip.files import load as load_scenario
from spots_sim.strip.scenario import Scenario

HELD_S = 2.0  # a finger touches the key 5 from this time on
HELD = ScenarioFile(
    seconds=60,
    touch=[Finger(points=[(HELD_S, 38.0, 0), (HELD_S + 0.02, 38.0, 1500), (50, 38.0, 1500)])],
)


class Computer(Keyboard):
    """Substitute for this computer's keyboard: records key events, or fails at the first one."""

    def __init__(self, fails=None):
        super().__init__()
        self.typed = TypedText()
        self.fails = fails

    def _set(self, one, pressed):
        bits = sum(1 << key.usage - 0xE0 for key in self._down if 0xE0 <= key.usage <= 0xE7)
        if not 0xE0 <= one.usage <= 0xE7:
            self.typed.key(one.page, one.usage, bits, pressed)
        if pressed and self.fails:
            raise self.fails


@pytest.fixture
def board(sensor, calibration):
    """A calibrated board with a finger that touches the strip and does not lift."""
    with Board(LockstepLink(sensor, Scenario(HELD), 0)) as made:
        prepare(made, calibration)
        yield made


@pytest.mark.board
def test_a_finger_types_and_the_end_of_the_time_lets_go(board):
    with Computer() as computer:
        type_on(board, load("digits"), computer, HELD_S + 1 - board.now_s())
        assert computer.typed.text == "5"
        assert not computer.typed.down


@pytest.mark.parametrize("end", [SpotsError("unplugged"), KeyboardInterrupt(), ValueError()])
def test_whatever_ends_it_lets_go(board, monkeypatch, end):
    """The pressed key is released if the board is unplugged, at Ctrl-C, and at a defect."""
    within = FrameIterator.within

    def ended(frames, seconds):
        if board.now_s() > HELD_S + 0.5:
            raise end
        return within(frames, seconds)

    monkeypatch.setattr(FrameIterator, "within", ended)
    with Computer() as computer:
        with pytest.raises(type(end)):
            type_on(board, load("digits"), computer)
        assert computer.typed.presses == 1
        assert not computer.typed.down


def test_a_keyboard_that_fails_in_the_middle_of_a_key_lets_go(board):
    computer = Computer(fails=RequirementError("the device is gone"))
    with refusal(RequirementError), computer:
        type_on(board, load("digits"), computer)
    assert computer.typed.presses == 1
    assert not computer.typed.down


def test_a_board_that_falls_silent_holds_no_key(board):
    computer, engine = Computer(), None
    engine = KeyEngine(load("digits"), 85_000, computer)
    board.command("stream touch")
    for frame in board.frames(HELD_S + 0.5 - board.now_s()):
        if isinstance(frame, Touch):
            engine.take(frame, board.now_s())
    heard_s = board.now_s()
    engine.tick(heard_s + RELEASE_S - 0.01)
    assert computer.typed.down
    engine.tick(heard_s + RELEASE_S + 0.01)
    assert not computer.typed.down


def test_a_finger_that_comes_while_the_board_is_silent_is_a_new_one():
    computer = Computer()
    engine = KeyEngine(load("digits"), 85_000, computer)

    def read(now_s, flags, force_mN):
        t_us = round(1e6 * now_s)
        engine.take(Touch(0, 0, t_us, flags, 0, 0, 38_000, force_mN, now_s), now_s)

    for i in range(10):
        read(0.01 * i, 4, 0)
    engine.tick(5.0)
    for i in range(3):
        read(5.0 + 0.01 * i, 1, 1500)
    assert computer.typed.text == "5"
    engine.tick(6.0)
    for i in range(30):
        read(6.0 + 0.01 * i, 1, 1500)  # the same finger, whose key was released
    assert computer.typed.presses == 1
    assert not computer.typed.down


WAITING = """[tuning]
    double_ms = 250
    [[layer]]
    name = "a"
    keys = [
      {tap = "A", double = "B"},
      {tap = "C", hold = "D"},
      {tap = "sticky b"},
      {tap = "toggle b"},
      {tap = "E", firm = "F"},
    ]
    [[layer]]
    name = "b"
    keys = ["1", "2", "3", "toggle b", "5"]
    """


class Strip:
    """A key engine on the host that gets the readings of a simulated finger."""

    def __init__(self, tmp_path):
        path = tmp_path / "waiting.toml"
        path.write_text('name = "x"\n' + WAITING)
        self.computer = Computer()
        self.engine = KeyEngine(load(path), 85_000, self.computer)
        self.now_s = 1.0
        self.lift(10)

    def read(self, flags, key=0, force_mN=1500):
        self.now_s += 0.01
        x_um = round(85_000 * (key + 0.5) / 5)
        touch = Touch(0, 0, round(1e6 * self.now_s), flags, 0, 0, x_um, force_mN, self.now_s)
        self.engine.take(touch, self.now_s)
        self.engine.tick(self.now_s)

    def press(self, key, count=8):
        for _ in range(count):
            self.read(1, key)

    def lift(self, count=8):
        for _ in range(count):
            self.read(4, 0, 0)

    def silence(self, seconds, ticking):
        end_s = self.now_s + seconds
        while ticking and self.now_s < end_s:
            self.now_s += 0.02
            self.engine.tick(self.now_s)
        self.now_s = end_s


@pytest.mark.parametrize("ticking", [True, False])
@pytest.mark.parametrize("key", [0, 1, 4])
@pytest.mark.parametrize("lifted", [True, False])
@pytest.mark.parametrize("seconds", [0.4, 600, 4294.9])  # the last one: the board's clock wraps
def test_silence_forgets_what_a_touch_would_have_pressed(tmp_path, ticking, key, lifted, seconds):
    """After a time without readings, a pending tap or hold presses no key.

    This is also true if `tick` was not called during this time.
    """
    strip = Strip(tmp_path)
    strip.press(key)
    if lifted:
        strip.lift()
        strip.press(0)  # a tap on a key that waits for a double tap
        strip.lift()
    pressed = strip.computer.typed.presses
    strip.silence(seconds, ticking and seconds < 1000)
    strip.lift(50)
    assert strip.computer.typed.presses == pressed
    assert not strip.computer.typed.down


def test_silence_ends_a_layer_for_one_key_and_keeps_one_that_is_locked(tmp_path):
    strip = Strip(tmp_path)
    strip.press(2)
    strip.lift()
    assert strip.engine.layer == "b"
    strip.silence(1, True)
    assert strip.engine.layer == "a"
    strip.lift()
    strip.press(3)
    strip.lift()
    strip.silence(1, True)
    assert strip.engine.layer == "b"


def test_readings_without_light_are_silence(tmp_path):
    strip = Strip(tmp_path)
    strip.press(1, 40)
    assert strip.computer.typed.down
    for _ in range(40):
        strip.read(LED_OFF)
    assert not strip.computer.typed.down


@pytest.mark.parametrize("average", [4, 1 << 20])
def test_a_board_too_slow_for_keys_is_refused_in_a_sentence(average):
    board = SimpleNamespace(
        command=lambda line: {"length_um": 85_000, "exposure_us": 100_000, "average": average}
    )
    for start in (
        lambda: type_on(board, load("digits"), Computer()),
        lambda: play(board, lambda one: None, None, False, Mapping()),
    ):
        with refusal(BoardError, why="too_slow"):
            start()


def test_what_rests_on_the_strip_becomes_its_untouched_state(board, tmp_path):
    path = tmp_path / "rests.toml"
    path.write_text(
        'name = "x"\n[tuning]\nstuck_ms = 3000\n[[layer]]\nname = "a"\nkeys = ["A", "B"]\n'
    )
    computer = Computer()
    type_on(board, load(path), computer, HELD_S + 4 - board.now_s())
    assert computer.typed.text == "a"
    assert sum(board.command("get")["baseline"]) > 0
    board.command("stream touch")
    later = [frame for frame in board.frames(1.0) if isinstance(frame, Touch)]
    assert not any(frame.touching for frame in later[10:])


def test_resting_is_followed_on_the_board_too(board, tmp_path):
    path = tmp_path / "rests.toml"
    path.write_text(
        'name = "x"\n[tuning]\nstuck_ms = 3000\n[[layer]]\nname = "a"\nkeys = ["A", "B"]\n'
    )
    push(board, load(path))
    for _ in board.frames(HELD_S + 4 - board.now_s()):
        pass
    assert sum(board.command("get")["baseline"]) > 0


def test_the_setting_of_earlier_firmware_is_answered(board):
    with refusal(BoardError, why="bad_value"):
        board.command("set baseline=1")


def test_a_board_without_a_calibration_is_told(sensor):
    bare = Board(LockstepLink(sensor, Scenario(HELD), 0))
    with bare, refusal(BoardError, why="no_calibration"):
        type_on(bare, load("digits"), Computer())


def test_the_typing_scenario_is_what_the_typist_makes(tmp_path):
    made = typing(load("mini"), "hello strip, type 42!\n", 85.0, seed=1, start_s=3.0)
    kept = load_scenario(ScenarioFile, "typing")
    assert kept.seconds == pytest.approx(made.seconds, abs=0.001)
    for ours, theirs in zip(kept.touch, made.touch):
        np.testing.assert_allclose(np.array(ours.points), np.array(theirs.points), atol=0.5)


@pytest.mark.board
def test_the_demo_types_the_scenarios_text(capsys):
    assert cli.main(["demo", "--use", "keyboard", "--fast", "--json", "--seconds", "13"]) == 0
    figures = json.loads(capsys.readouterr().out)
    assert figures["typed"] == "hello strip, type 42!\n"
    assert figures["keys_down"] == 0
    assert figures["host_agrees"]


@pytest.mark.board
def test_a_dry_run_prints_the_keys(capsys):
    arguments = ["keyboard", "--port", "virtual", "--dry-run", "--seconds", "8"]
    assert cli.main(arguments) == 0
    lines = capsys.readouterr().out.splitlines()
    assert lines
    assert len([line for line in lines if line.startswith("down")]) == len(
        [line for line in lines if line.startswith("up")]
    )


def test_a_board_that_is_a_keyboard_itself_only_allows_a_dry_run(board, monkeypatch, capsys):
    push(board, load("digits"))
    monkeypatch.setattr(
        "spots.keyboard.keyboard.open_announced", lambda options: nullcontext(board)
    )
    assert cli.main(["keyboard", "--seconds", "3"]) == 2
    assert "set keys=0" in capsys.readouterr().err
    assert cli.main(["keyboard", "--dry-run", "--seconds", "3"]) == 0
    assert "down" in capsys.readouterr().out


# Worn strips, on an arm.


def gestures_of(sensor, calibration, fingers, seconds, on_gesture=lambda one: None, **scenario):
    file = ScenarioFile(seconds=seconds + 1, touch=fingers, **scenario)
    with Board(LockstepLink(sensor, Scenario(file), 0)) as board:
        prepare(board, calibration)
        return play(board, on_gesture, seconds - board.now_s(), False, Mapping())


@pytest.mark.board
def test_gestures_through_the_firmware(sensor, calibration):
    typist = Typist(load("digits"), 85.0, np.random.default_rng(0), start_s=2.0)
    typist.press(0.5, 0.1, 1500)
    typist.seconds += 0.8
    typist.press(0.5, 0.1, 1500)
    typist.seconds += 0.1
    typist.press(0.52, 0.1, 1500)
    typist.seconds += 0.8
    typist.press(0.3, 0.9, 1500)
    typist.seconds += 0.5
    typist.press(0.3, 0.4, 8000)
    at_s = typist.seconds + 0.5
    swipe = Finger(
        points=[
            (at_s, 20, 0),
            (at_s + 0.02, 20, 1500),
            (at_s + 0.2, 60, 1500),
            (at_s + 0.22, 60, 0),
        ]
    )
    slide_s = at_s + 1
    slide = Finger(
        points=[
            (slide_s, 60, 0),
            (slide_s + 0.02, 60, 1500),
            (slide_s + 0.5, 60, 1500),
            (slide_s + 1, 30, 1500),
            (slide_s + 1.02, 30, 0),
        ]
    )
    found = gestures_of(sensor, calibration, [*typist.touches, swipe, slide], slide_s + 2)
    assert [one.name for one in found] == [
        g.TAP, g.DOUBLE_TAP, g.HOLD, g.SQUEEZE, g.SWIPE_PLUS, g.SLIDE_MINUS
    ]  # fmt: skip
    assert min(one.confidence for one in found) > 0.6


@pytest.mark.board
@pytest.mark.parametrize("seed", [0, 1])
def test_every_gesture_on_an_arm_that_moves_and_sweats(sensor, calibration, seed):
    file = load_scenario(ScenarioFile, "worn")
    with Board(LockstepLink(sensor, Scenario(file), seed)) as board:
        prepare(board, calibration)
        found = play(board, lambda one: None, file.seconds - board.now_s(), False, Mapping())
    once = [
        g.TAP, g.DOUBLE_TAP, g.HOLD, g.SQUEEZE,
        g.SWIPE_PLUS, g.SWIPE_MINUS, g.SLIDE_PLUS, g.SLIDE_MINUS,
    ]  # fmt: skip
    assert [one.name for one in found] == 2 * once
    assert min(one.confidence for one in found) > 0.9


@pytest.mark.board
def test_a_held_press_is_never_taken_for_the_untouched_strip(sensor, calibration):
    """The press lasts longer than any change of the baseline; light leaks, and the arm bends."""
    held = Finger(points=[(2.0, 40.0, 0), (2.1, 40.0, 2500), (14.0, 42.0, 2900), (14.1, 42.0, 0)])
    leak = [(0.0, 0.0, 30.0), (15.0, 0.01, 30.0)]
    found = gestures_of(
        sensor, calibration, [held], 15.0, leak=leak, bend=[(0.0, 0.0), (15.0, 90.0)]
    )
    assert [one.name for one in found] == [g.HOLD]


def test_a_gesture_presses_and_releases_its_key_if_it_is_sure():
    mapping, computer = Mapping(), Computer()
    tap = g.Gesture(g.TAP, 0.9, 0, 0, 0, 0.0)
    mapping.do(tap, computer)
    assert computer.typed.presses == 1
    assert not computer.typed.down
    mapping.do(tap._replace(confidence=0.3), computer)
    assert computer.typed.presses == 1


@pytest.mark.parametrize(
    ("text", "why"),
    [
        ('[gestures]\nwave = "A"', "wave: no such gesture: valid names are tap"),
        ('[gestures]\ntap = "PLAY_PAUS"', "tap: there is no key 'PLAY_PAUS'.*PLAY_PAUSE"),
        ("least_confidence = 2\n[gestures]", "least_confidence"),
        ("gestures = 1", "gestures"),
        ("[gestures", "gestures file"),
    ],
)
def test_a_mistake_in_the_gestures_file_is_told(tmp_path, capsys, text, why):
    path = tmp_path / "mine.toml"
    path.write_text(text)
    with pytest.raises(SpotsError, match=why):
        Mapping(path)
    assert cli.main(["wearable", "--gestures", str(path), "--port", "virtual"]) == 2
    assert capsys.readouterr().err.count("\n") == 1


def test_the_default_file_has_a_key_for_every_gesture_of_one_finger():
    assert set(Mapping(DEFAULT).keys) == set(g.NAMES) - {g.TWO_FINGER_SQUEEZE, g.ANCHOR_AND_SLIDE}
