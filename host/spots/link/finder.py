"""Finds a board again by its id, after it was unplugged or its port got another name."""

from __future__ import annotations

from argparse import Namespace
from collections.abc import Callable

from ..errors import PortError, RefusedError, SpotsError
from .board import Board
from .connect import find, of_id, open_with
from .ports import offered, scheme_name


def finder(port: str | None, options: Namespace | None = None) -> Callable[[str | None], Board]:
    """Return a function that finds and opens a board, also after a restart.

    ``open_board(board_id)`` opens the board with this id, or any board if the id is None. Without
    `port`, the board is found on USB. The ability ``check(target, options)`` of a kind of port, see
    `ports`, raises SpotsError if every call of ``open_port`` would fail.
    """
    check = offered(port, "check")
    if check is not None:
        check((port or "").partition(":")[2], options)

    def open_board(board_id: str | None) -> Board:
        if board_id is None:
            return open_with(port, options)
        found: list[Board] = []
        if port is not None:
            try:
                found.append(open_with(port, options))
            except SpotsError:
                if scheme_name(port):
                    raise
        refusal = RefusedError if found else PortError
        if not found or found[0].info["id"] != board_id:
            found += find()[0]  # after a restart a serial port may have another name
        wanted = []
        try:
            wanted = of_id(found, board_id)
        finally:
            for one in found:
                if one not in wanted:
                    one.close()
        if not wanted:
            raise refusal(f"waiting for board {board_id}: plug it in again")
        return wanted[0]

    return open_board
