"""``spots monitor`` and ``spots replay``: show the readings of a board."""

import math
from contextlib import suppress

from ..link.board import Board
from ..link.calibrated import next_step
from ..link.frames import Touch
from ..link.untrusted import Untrusted
from .view import Judge, Pace, StripView, drawn, plain

PLAIN_LINES_PER_S = 4


def watch(board: Board, seconds: float | None, quiet: bool, judge: Judge | None = None) -> None:
    """Show a board's readings for a given time or until Ctrl-C.

    In a terminal, show a live picture; otherwise print lines.

    Parameters
    ----------
    board : Board
        The board to read.
    seconds : float or None
        Duration, in seconds by the clock of `Board.now_s`; no limit if None.
    quiet : bool
        Whether to print nothing.
    judge : Judge, optional
        Compares the readings with the true values, if these are known.

    Raises
    ------
    SpotsError
        If the board is closed or refuses a command.
    """
    board.patience_s = math.inf
    with suppress(KeyboardInterrupt), drawn(not quiet) as display:
        board.command("stream touch spectrum" if display else "stream touch")
        info = board.command("hello")
        view, untrusted = StripView(info, board.port), Untrusted()
        advising = not quiet and not next_step(info)  # otherwise the command prints it
        started_s = board.now_s()
        pace = Pace() if display else Pace(PLAIN_LINES_PER_S)

        def show_state(state: str) -> None:
            view.state = state
            if display:
                display.update(view.picture(board.stats, judge), refresh=True)
            elif not quiet:
                print(f"{board.now_s() - started_s:8.3f} s  link {state}", flush=True)

        board.when_state_changes(show_state)
        for frame in board.frames(seconds):
            now_s = board.now_s()
            view.take(frame)
            if isinstance(frame, Touch) and advising:
                (untrusted.take if display else untrusted.warn)(frame, now_s)
                view.advice = untrusted.sentence
            if isinstance(frame, Touch) and judge is not None:
                judge.take(frame, now_s)
            if display and pace.due(now_s):
                display.update(view.picture(board.stats, judge), refresh=True)
            elif not display and not quiet and isinstance(frame, Touch) and pace.due(now_s):
                print(plain(frame, started_s, view.unit), flush=True)
