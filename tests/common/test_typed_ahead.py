"""What is typed before a question does not answer it, at any prompt of any command."""

import io
import os
import pty
import re
import sys
from pathlib import Path

import pytest
from rich.console import Console
from support.refusals import refusal

import spots
from spots.calibrate.fit.points import Wanted
from spots.calibrate.session.guide import Guide
from spots.calibrate.session.presser import Presser
from spots.deploy.confirm import confirm
from spots.errors import StateError
from spots_linkage import twin_points

QUESTION = re.compile(r"[?:] ?$|\) $|\] $")
WANTED = Wanted(kind="hand", place_um=42_500.0, force_mN=3000.0)


class Screen(io.StringIO):
    """A screen before which a person types the next line of `lines` when a question appears."""

    def __init__(self, write, lines):
        super().__init__()
        self._write, self._lines = write, lines

    def write(self, text):
        if QUESTION.search(text) and self._lines:
            self._write(self._lines.pop(0).encode())
        return super().write(text)


@pytest.fixture(params=["terminal", "pipe"])
def typing(request, monkeypatch):
    """Function that takes the lines to type, and returns the screen; standard input is replaced."""
    behind, front = pty.openpty() if request.param == "terminal" else reversed(os.pipe())
    stdin = os.fdopen(front)
    monkeypatch.setattr(sys, "stdin", stdin)

    def typing(*lines):
        screen = Screen(lambda data: os.write(behind, data), list(lines))
        monkeypatch.setattr(sys, "stdout", screen)
        return screen

    typing.at_terminal = request.param == "terminal"
    yield typing
    stdin.close()
    os.close(behind)


def ask_in_session(question):
    return Guide(Console(file=sys.stdout, width=300)).ask(question)


@pytest.mark.parametrize("ask", [ask_in_session, twin_points._ask])
def test_lines_typed_ahead_answer_no_later_question_at_a_terminal(ask, typing):
    typing("60mm\n\n\n", "70mm\n")
    answers = [ask("where? "), ask("where? ")]
    assert answers == (["60mm", "70mm"] if typing.at_terminal else ["60mm", ""])


def test_enter_that_was_typed_twice_stores_no_place_where_nobody_pressed(typing):
    screen = typing("60mm 310g\n\n\n", "33mm 200g\n")
    presser = Presser(Guide(Console(file=screen, width=300)))
    read = [presser.read_off(WANTED, 85_000.0) for _ in range(2)]
    places = [60_000.0, 33_000.0 if typing.at_terminal else WANTED.place_um]
    assert [wanted.place_um for wanted in read] == places


def test_a_yes_that_was_typed_ahead_does_not_erase_a_board(typing):
    typing("no\ny\n", "no\n")
    for _ in range(2):
        with refusal(StateError):
            confirm("erase", "remove it?", "nothing was removed")


def test_every_prompt_drops_what_was_typed_ahead():
    asks = re.compile(r"(?<![\w.])input\(|stdin\)?\.readline\(")
    found = []
    for file in Path(spots.__file__).parents[1].rglob("*.py"):
        text = file.read_text()
        if asks.search(text):
            found.append(file.stem)
            assert "typed_ahead.drop(" in text, file
    assert sorted(found) == ["confirm", "doctor", "guide", "record", "twin_points"]
