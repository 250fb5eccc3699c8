"""Functions for applications that need a calibrated board: length, rate, baseline, readings."""

import contextlib
import math
from collections.abc import Callable, Iterator

from ..errors import SpotsError
from ..signals import resumed
from .board import Board
from .frames import Touch
from .replies import Hello
from .timeouts import ANSWER_S
from .untrusted import Untrusted

_FOLLOW = "set baseline=1"


def hello_calibrated(board: Board) -> Hello:
    """Return the reply to ``hello`` of a board, which must be calibrated.

    Raises
    ------
    SpotsError
        If the board has no calibration for its present settings.
    """
    info = board.command("hello")
    if not info.get("length_um"):
        raise SpotsError(
            f"the board on {board.port} has no calibration for its settings: run 'spots calibrate'"
        )
    return info


def next_step(info: Hello) -> str | None:
    """Return advice for the user if a reply to ``hello`` shows no calibration, else None."""
    return None if info.get("length_um") else "next: spots calibrate"


def hello_often(
    board: Board, within_s: float, remedy: str = "set a shorter exposure_us or a smaller average"
) -> Hello:
    """Return the reply to ``hello`` of a board, which must be calibrated and fast enough.

    Parameters
    ----------
    board : Board
        The board.
    within_s : float
        Longest time from one reading to the next that the application allows, in seconds.
    remedy : str, optional
        Advice for the error message if the board is too slow.

    Returns
    -------
    Hello

    Raises
    ------
    SpotsError
        If the board is too slow, or has no calibration for its present settings.
    """
    info = hello_calibrated(board)
    every_s = info["exposure_us"] * info["average"] * 1e-6
    if every_s > within_s:
        raise SpotsError(
            f"the board takes a reading every {every_s:g} s, but this application needs one every "
            f"{within_s:g} s: {remedy}"
        )
    return info


def request_baseline(board: Board) -> None:
    """Ask the board to take the present light as the baseline; ignore a missing reply.

    The baseline is the light of the untouched strip.
    """
    if not board.read_only:
        with contextlib.suppress(SpotsError):
            board.command("rest")


def ticks(
    board: Board, seconds: float | None, tick_s: float, forget: Callable[[], None]
) -> Iterator[Iterator[Touch]]:
    """Yield the readings of successive time intervals (ticks), with baseline tracking on.

    The setting ``baseline=1`` is sent again after a restart of the board. When this process is
    resumed after Ctrl-Z, older readings are dropped. When all readings become untrusted, the cause
    is printed on stderr.

    Parameters
    ----------
    board : Board
        The board to read.
    seconds : float or None
        Duration, in seconds by the clock of `Board.now_s`; no limit if None. The end of a
        recording also ends the iteration.
    tick_s : float
        Length of a tick, in seconds.
    forget : callable
        ``forget()`` is called when this process is resumed; it should drop the present touch.

    Yields
    ------
    iterator of frames.Touch
        Readings of the board's first sensor, as they arrive until the end of the tick.
    """
    restarts = board.stats.restarts
    if not board.read_only:
        board.command(_FOLLOW)
    board.command("stream touch")
    end_s = None if seconds is None else board.now_s() + seconds
    since_s, untrusted = -math.inf, Untrusted()

    def taken() -> Iterator[Touch]:
        for touch in board.touches(tick_s):
            if touch.sensor == 0 and (touch.time_s or 0.0) >= since_s:
                untrusted.warn(touch, board.now_s())
                yield touch

    while not board.ended and (end_s is None or board.now_s() < end_s):
        if board.stats.restarts != restarts and not board.read_only:
            before = board.stats.restarts
            with contextlib.suppress(SpotsError):  # no answer: try again at the next tick
                board.command(_FOLLOW, ANSWER_S)
                restarts = before
        if resumed():
            forget()
            since_s = board.now_s()
        yield taken()
