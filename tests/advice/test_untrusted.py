"""All readings of a strip are untrusted: each application reports this within a second."""

import io
import re

import pytest
from rich.console import Console

from spots.advice.untrusted import Untrusted
from spots.controller import controller
from spots.controller.controller_settings import load as load_settings
from spots.keyboard.keyboard import type_on
from spots.keyboard.layout import load
from spots.link.board import Board
from spots.link.connect import prepare, upload
from spots.link.frames import Touch
from spots.outputs.devices import PrintedGamepad, PrintedKeyboard
from spots.terminal import view
from spots.terminal.monitor import watch
from spots.wearable.wearable import Mapping, play
from spots_device.reading.decode import (
    FITS_WITH_DRIFT,
    LED_OFF,
    MISFIT,
    NOT_CALIBRATED,
    SATURATED,
    TOO_DARK,
    TOUCHING,
)
from spots_sim.board.lockstep import LockstepLink
from spots_sim.person.stage import Stage
from spots_sim.strip.change import Change
from spots_sim.strip.files import Finger, ScenarioFile
from spots_sim.strip.scenario import Scenario

TWO_S = 2.0  # two fingers touch from this time on
WITHIN_S = 1.0
BEGUN_S = 0.1  # time until both fingers touch firmly, and no reading fits one press
TWO = ScenarioFile(
    seconds=60,
    touch=[
        Finger(points=[(TWO_S, place_mm, 0), (TWO_S + 0.02, place_mm, 4000), (50, place_mm, 4000)])
        for place_mm in (15.0, 70.0)
    ],
)


def nothing(_):
    pass


def as_keyboard(board, seconds):
    type_on(board, load("digits"), PrintedKeyboard(), seconds)


def as_controller(board, seconds):
    made = controller.controller_for(board, load_settings())
    controller.play(board, made, PrintedGamepad(), seconds)


def as_wearable(board, seconds):
    play(board, nothing, seconds, False, Mapping())


@pytest.mark.board
@pytest.mark.parametrize("run", [as_keyboard, as_controller, as_wearable])
def test_only_untrusted_readings_are_reported_within_a_second(sensor, calibration, run, capsys):
    with Board(LockstepLink(sensor, Scenario(TWO), 0)) as board:
        prepare(board, calibration)
        run(board, TWO_S + BEGUN_S - board.now_s())
        assert capsys.readouterr().err == ""
        run(board, TWO_S + WITHIN_S - board.now_s())
        said = capsys.readouterr().err
        assert "untrusted" in said
        assert "two fingers touch the strip" in said
        assert "fit one press" in said
        assert "next: " in said
        run(board, 3 * WITHIN_S)
        assert capsys.readouterr().err.count("\n") == 1


def reading(flags):
    return Touch(0, 0, 0, flags, 0, 0, 0, 0, 0.0)


@pytest.mark.parametrize(
    ("flags", "words"),
    [
        (TOUCHING | MISFIT, "fit one press"),
        (TOUCHING | MISFIT, "two fingers"),
        (TOUCHING | FITS_WITH_DRIFT, "has drifted"),
        (TOUCHING | FITS_WITH_DRIFT, "spots doctor"),
        (MISFIT, "fit one press"),
        (SATURATED | MISFIT | TOUCHING, "saturated"),
        (NOT_CALIBRATED, "spots calibrate"),
        (LED_OFF, "dark frame"),
    ],
)
def test_each_cause_has_a_sentence_with_a_next_step(flags, words):
    untrusted = Untrusted()
    for i in range(100):
        untrusted.take(reading(flags), 0.01 * i)
    assert words in untrusted.sentence
    assert "; next: " in untrusted.sentence


@pytest.mark.parametrize("good", [TOUCHING, TOO_DARK, 0])
def test_one_good_reading_ends_it_and_nothing_is_said_of_a_strip_that_nobody_touches(good):
    untrusted = Untrusted()
    for i in range(300):
        untrusted.take(reading(good if i % 50 == 0 else MISFIT), 0.01 * i)
        assert untrusted.sentence == ""
    for i in range(300, 400):
        untrusted.take(reading(MISFIT), 0.01 * i)
    assert untrusted.sentence
    untrusted.take(reading(good), 4.0)
    assert untrusted.sentence == ""


@pytest.mark.board
def test_short_presses_that_do_not_fit_are_reported_until_one_is_trusted(sensor, calibration):
    untrusted, said = Untrusted(), []
    with Stage(sensor) as stage:
        upload(stage.board, calibration)
        stage.board.command("dark", timeout_s=5)
        stage.board.command("stream touch")
        for die_nm in (1.0, 1.0, 1.0, 1.0, 1.0, 1.0, 0.0):
            stage.held.changed = Change(die_nm=die_nm)
            stage.press(40_000, 3000)
            for _ in ("pressed", "released"):
                for touch in stage.board.touches(0.2):
                    untrusted.take(touch, stage.board.now_s())
                stage.release()
                said.append("has drifted" in untrusted.sentence)
                assert "two fingers" not in untrusted.sentence
    assert said[:2] == [False, False]
    assert said[-4:] == [True, True, False, False]
    assert said == sorted(said[:-2]) + [False, False]


def test_a_lamp_that_is_switched_now_and_then_is_not_reported():
    untrusted = Untrusted()
    for i in range(1000):
        untrusted.take(reading(MISFIT if i % 50 < 30 else 0), 0.01 * i)
        assert untrusted.sentence == ""


def test_a_dark_frame_after_presses_that_do_not_fit_is_not_the_cause():
    untrusted = Untrusted()
    for i, flags in enumerate([TOUCHING | MISFIT] * 68 + [LED_OFF] * 6 + [TOUCHING | MISFIT] * 15):
        untrusted.take(reading(flags), 0.01 * i)
        assert "dark frame" not in untrusted.sentence
    assert "re-zero is advised" in untrusted.sentence


@pytest.mark.parametrize(("presses", "word"), [(1, "two fingers"), (2, "drifted")])
def test_a_second_press_that_does_not_fit_shows_a_drift(presses, word):
    untrusted = Untrusted()
    for i in range(80):
        pressed = i % 40 if presses > 1 else i
        untrusted.take(reading(TOUCHING | MISFIT if pressed else TOO_DARK), 0.02 * i)
    assert untrusted.sentence.startswith("every reading is untrusted, because")
    assert word in untrusted.sentence


@pytest.mark.parametrize(("first", "word"), [(TOUCHING, "two fingers"), (TOO_DARK, "drifted")])
def test_another_finger_after_a_trusted_one_is_no_drift(first, word):
    untrusted = Untrusted()
    for i in range(40):
        untrusted.take(reading(TOUCHING | FITS_WITH_DRIFT if i else first), 0.02 * i)
    assert word in untrusted.sentence
    assert untrusted.drifted == (first == TOO_DARK)


@pytest.mark.board
def test_monitor_advises_a_re_zero_within_a_second(sensor, calibration, capsys):
    with Board(LockstepLink(sensor, Scenario(TWO), 0)) as board:
        prepare(board, calibration)
        watch(board, TWO_S + BEGUN_S - board.now_s(), quiet=False)
        assert capsys.readouterr().err == ""
        watch(board, TWO_S + WITHIN_S - board.now_s(), quiet=False)
        assert "re-zero is advised: spots rezero" in capsys.readouterr().err
        watch(board, WITHIN_S, quiet=True)
        assert capsys.readouterr().err == ""


@pytest.mark.board
def test_the_picture_of_monitor_advises_a_re_zero(sensor, calibration, monkeypatch):
    screen = Console(file=io.StringIO(), force_terminal=True, width=100)
    monkeypatch.setattr(view, "Console", lambda: screen)
    with Board(LockstepLink(sensor, Scenario(TWO), 0)) as board:
        prepare(board, calibration)
        watch(board, TWO_S + BEGUN_S - board.now_s(), quiet=False)
        assert "untrusted" not in screen.file.getvalue()
        watch(board, TWO_S + WITHIN_S + 0.2 - board.now_s(), quiet=False)
        assert "re-zero is advised: spots rezero" in re.sub(r"\s*│\s*", " ", screen.file.getvalue())


def test_a_slow_board_is_reported_within_a_second_too():
    untrusted = Untrusted()
    for i in range(4):
        untrusted.take(reading(MISFIT), 0.3 * i)
    assert untrusted.sentence
