"""Opens the board of a command that shows a picture, and says so in the terminal."""

import sys
from argparse import Namespace

from ..link.board import Board
from ..link.connect import open_named

_TEXT = "opening the board ..."


def open_announced(options: Namespace) -> Board:
    """Open the board that a command's options name, see `connect.open_named`.

    A terminal shows a line until the board is open: a virtual board takes seconds.
    """
    if not sys.stderr.isatty():
        return open_named(options)
    print(_TEXT, end="\r", file=sys.stderr, flush=True)
    try:
        return open_named(options)
    finally:
        print(" " * len(_TEXT), end="\r", file=sys.stderr, flush=True)
