"""What every use asks a board first: where its strip ends, which only a calibration knows."""

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
