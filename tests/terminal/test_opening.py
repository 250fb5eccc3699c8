"""While a board is being opened, a terminal shows a line."""

import io
from argparse import Namespace
from unittest.mock import Mock

import pytest

from spots import SpotsError
from spots.terminal import opening


class Terminal(io.StringIO):
    tty = True

    def isatty(self):
        return self.tty


@pytest.mark.parametrize("fails", [False, True])
@pytest.mark.parametrize("tty", [False, True])
def test_a_terminal_shows_a_line_until_the_board_is_open(fails, tty, monkeypatch):
    terminal = Terminal()
    terminal.tty = tty
    monkeypatch.setattr(opening.sys, "stderr", terminal)
    shown, board = [], Mock()

    def open_named(options):
        shown.append(terminal.getvalue())
        if fails:
            raise SpotsError("no board")
        return board

    monkeypatch.setattr(opening, "open_named", open_named)
    try:
        assert opening.open_announced(Namespace(port="A")) is board
    except SpotsError:
        assert fails
    assert shown == ["opening the board ...\r" if tty else ""]
    *_, last = terminal.getvalue().split("\r")[:-1] or [""]
    assert last.strip() == ""
    assert terminal.getvalue().endswith("\r") is tty
