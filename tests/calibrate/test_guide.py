"""What a session leaves on a terminal: no torn picture, after any number of questions."""

import io
import os
import pty
import re
import termios

import pytest
from rich.console import Console

from spots.calibrate.fit.points import Wanted
from spots.calibrate.session.guide import Guide

CODE = re.compile(r"\x1b\[(\??[\d;]*)([A-Za-z])|(\r)|(\n)|([^\x1b\r\n]+)")


def screen(text):
    """Return the lines that a terminal shows after `text`: it moves up, and erases lines."""
    lines, row, column = [""], 0, 0
    for number, code, home, down, word in CODE.findall(text):
        if code == "A":
            row -= int(number or 1)
            assert row >= 0
        elif code == "K":
            lines[row] = ""
        elif home:
            column = 0
        elif down:
            row, column = row + 1, 0
            lines += [""] * (row + 1 - len(lines))
        elif word:
            lines[row] = lines[row][:column].ljust(column) + word + lines[row][column + len(word) :]
            column += len(word)
    return lines


@pytest.mark.parametrize(("columns", "rows"), [(80, 24), (110, 45)])
def test_each_picture_is_erased_before_a_question(columns, rows):
    """Fails if a part of a picture stays above the next one; no other test reads the screen."""
    file = io.StringIO()
    console = Console(file=file, force_terminal=True, width=columns, height=rows)
    answers = iter(["1mm"] * 10)

    class Typing:
        def readline(self):
            file.write(next(answers) + "\n")  # as the terminal echoes it
            return "1mm\n"

    with Guide(console, Typing()) as guide:
        guide.begin("presses", 10, ("F3", "F4", "F5", "F6", "F7", "F8"), 85_000.0)
        for i in range(10):
            guide.want(Wanted(kind="hand", place_um=8000.0 * i, force_mN=0.0, strain_ppm=0))
            guide.say(f"press {i} " + "and hold " * (3 * i))
            assert guide.ask("what does the ruler show? ", 8000.0 * i) == "1mm"
        guide.say("done")
    shown = screen(file.getvalue())
    assert sum("╭" in line for line in shown) == sum("╰" in line for line in shown) == 1
    assert sum("what does the ruler show? 1mm" in line for line in shown) == 10


def test_the_terminal_shows_only_what_answers_a_question(monkeypatch):
    """Fails if an Enter without a question tears the picture, or an answer is typed blindly."""
    ours, theirs = pty.openpty()
    seen = []

    def look():
        seen.append(bool(termios.tcgetattr(theirs)[3] & termios.ECHO))

    class Typing:
        def readline(self):
            look()
            return "1mm\n"

    with os.fdopen(theirs) as stdin, os.fdopen(ours):
        monkeypatch.setattr("sys.stdin", stdin)
        with Guide(Console(file=io.StringIO(), force_terminal=True), Typing()) as guide:
            look()
            guide.ask("what does the ruler show? ")
            look()
        look()
    assert seen == [False, True, False, True]
