"""What uses have to do with a board first: ask where its strip ends, tell it how to feel."""

from __future__ import annotations

from ..board import Board
from ..errors import SpotsError


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
