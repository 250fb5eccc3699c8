"""Readings of a calibrated board for applications: length, rate, baseline, timeouts."""

from __future__ import annotations

import contextlib
import math
from collections.abc import Callable, Iterator

from ..errors import SpotsError
from ..signals import resumed
from .board import Board
from .frames import Touch
from .replies import Hello
from .timeouts import ANSWER_S

_FOLLOW = "set baseline=1"


def hello_calibrated(board: Board) -> Hello:
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


def next_step(info: Hello) -> str | None:
    """Return what to do with a board that is not calibrated, from its ``hello``; None if it is."""
    return None if info.get("length_um") else "next: spots calibrate position"


def hello_often(
    board: Board, within_s: float, remedy: str = "set a shorter exposure_us or a smaller average"
) -> Hello:
    """Return a board's ``hello``, as `hello_calibrated` does, if it reads often enough.

    Parameters
    ----------
    board : Board
    within_s : float
        The longest time from one reading to the next that the application can follow.
    remedy : str, optional
        What to do about a board that is slower.

    Returns
    -------
    Hello

    Raises
    ------
    SpotsError
        If it is slower, or has no calibration.
    """
    info = hello_calibrated(board)
    every_s = info["exposure_us"] * info["average"] * 1e-6
    if every_s > within_s:
        raise SpotsError(
            f"the board takes a reading every {every_s:g} s, and this application needs one every "
            f"{within_s:g} s: {remedy}"
        )
    return info


def length_of(board: Board) -> int:
    """Return the length of a board's strip in um; raises as `hello_calibrated` does."""
    return hello_calibrated(board)["length_um"] or 0


def tell_board(board: Board, line: str) -> None:
    """Send a command, unless the board is read-only.

    Parameters
    ----------
    board : Board
        The board.
    line : str
        The command, as for `Board.command`.

    Raises
    ------
    SpotsError
        If the board refuses the command, or is lost.
    """
    if not board.read_only:
        board.command(line)


def tell_rest(board: Board) -> None:
    """Let a board take what lies on the strip as its baseline; no error if it does not answer."""
    with contextlib.suppress(SpotsError):
        tell_board(board, "rest")


def ticks(
    board: Board, seconds: float | None, tick_s: float, forget: Callable[[], None]
) -> Iterator[Iterator[Touch]]:
    """Let a board follow its baseline, and yield its readings tick by tick.

    After a restart the board gets the setting again. After a stop of the process (Ctrl-Z)
    readings that were taken before it or meanwhile are dropped.

    Parameters
    ----------
    board : Board
    seconds : float or None
        Never end, if None; a recording ends by itself.
    tick_s : float
        How long a tick is.
    forget : callable
        Called after a stop of the process, to forget the touch and all that is pending.

    Yields
    ------
    iterator of frames.Touch
        The touches of the first sensor as they come; it ends with the tick.
    """
    restarts = board.stats.restarts
    tell_board(board, _FOLLOW)
    board.command("stream touch")
    end_s = None if seconds is None else board.now_s() + seconds
    since_s = -math.inf
    while not board.ended and (end_s is None or board.now_s() < end_s):
        if board.stats.restarts != restarts and not board.read_only:
            before = board.stats.restarts
            with contextlib.suppress(SpotsError):  # damaged, either way: at the next tick
                board.command(_FOLLOW, ANSWER_S)
                restarts = before
        if resumed():
            forget()
            since_s = board.now_s()
        frames = board.frames(tick_s)
        yield (
            frame
            for frame in frames
            if isinstance(frame, Touch) and frame.sensor == 0 and (frame.time_s or 0.0) >= since_s
        )
