"""What uses do with a board: ask where its strip ends, tell it how to feel, hear what it feels."""

from __future__ import annotations

from collections.abc import Iterator

from ..board import Board
from ..errors import SpotsError
from ..frames import Touch


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


def ticks(board: Board, seconds: float | None, tick_s: float) -> Iterator[Iterator[Touch]]:
    """Let a board follow the light of its untouched strip, and yield what it feels tick by tick.

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
    tell_board(board, "set baseline=1")
    board.command("stream touch")
    end_s = None if seconds is None else board.now_s() + seconds
    while not board.ended and (end_s is None or board.now_s() < end_s):
        frames = board.frames(tick_s)
        yield (frame for frame in frames if isinstance(frame, Touch) and frame.sensor == 0)
