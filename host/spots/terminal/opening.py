"""Opens the board of a command that shows its readings, and prints what a user must know of it."""

import sys
from argparse import Namespace
from collections.abc import Sequence

from ..errors import printable
from ..link.board import Board
from ..link.connect import open_named

_TEXT = "opening the board ..."


def open_announced(options: Namespace) -> Board:
    """Open the board that a command's options name, see `connect.open_named`.

    A terminal shows a line until the board is open: a virtual board takes seconds.
    """
    if not sys.stderr.isatty():
        return doubted(open_named(options))
    print(_TEXT, end="\r", file=sys.stderr, flush=True)
    try:
        return doubted(open_named(options))
    finally:
        print(" " * len(_TEXT), end="\r", file=sys.stderr, flush=True)


def doubted(board: Board) -> Board:
    """Return a board whose `close` prints what is wrong with a recording that has ended."""

    def warn() -> None:
        player = board.channel.player
        if player is not None and board.ended:  # not after Ctrl-C
            print_doubts(board.port, player.doubts)

    board.when_closed(warn)
    return board


def print_doubts(file: str, doubts: Sequence[str]) -> None:
    """Print what is wrong with a recording on stderr.

    Parameters
    ----------
    file : str
        Path of the recording.
    doubts : sequence of str
        See `spots.Recording.doubts`; if empty, nothing is printed.
    """
    if doubts:
        text = f"spots: {file} is read to its end, but {', and '.join(doubts)}"
        print(printable(text), file=sys.stderr)
