"""What uses do with a board: ask where its strip ends, tell it how to feel, hear what it feels."""

from __future__ import annotations

import contextlib
from collections.abc import Iterator

from ..board import Board
from ..errors import SpotsError
from ..frames import Touch

_FOLLOW = "set baseline=1"
_ANSWER_S = 0.1


def hello_calibrated(board: Board) -> dict:
    """Return a board's ``hello``.

    Raises
    ------
    SpotsError
        If it has no calibration that holds at its present settings.
    """
    info = board.command("hello")
    if not info.get("length_um"):
        raise SpotsError(
            "the board has no calibration that holds, so no touch has a place: run "
            "'spots calibrate position', then 'spots calibrate force'"
        )
    return info


def length_of(board: Board) -> int:
    """Return the length of a board's strip in um; raises as `hello_calibrated` does."""
    return hello_calibrated(board)["length_um"]


def tell_board(board: Board, line: str) -> None:
    """Send a command to a board that takes some; others feel with what they were set to."""
    if not board.read_only:
        board.command(line)


def tell_rest(board: Board) -> None:
    """Tell a board that what lies on the strip is no finger; if it does not hear it, no harm."""
    with contextlib.suppress(SpotsError):
        tell_board(board, "rest")


def ticks(board: Board, seconds: float | None, tick_s: float) -> Iterator[Iterator[Touch]]:
    """Let a board follow the light of its untouched strip, and yield what it feels tick by tick.

    A board that has restarted is told again.

    Parameters
    ----------
    board : Board
    seconds : float or None
        Never end, if None; a recording ends by itself.
    tick_s : float
        How long a tick is.

    Yields
    ------
    iterator of frames.Touch
        The touches of the first sensor as they come; it ends with the tick.
    """
    tell_board(board, _FOLLOW)
    board.command("stream touch")
    restarts = board.stats.restarts
    end_s = None if seconds is None else board.now_s() + seconds
    while not board.ended and (end_s is None or board.now_s() < end_s):
        if board.stats.restarts != restarts and not board.read_only:
            told = board.stats.restarts
            with contextlib.suppress(SpotsError):  # damaged, either way: at the next tick
                board.command(_FOLLOW, _ANSWER_S)
                restarts = told
        frames = board.frames(tick_s)
        yield (frame for frame in frames if isinstance(frame, Touch) and frame.sensor == 0)
