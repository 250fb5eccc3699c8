"""``spots monitor`` and ``spots replay``: show the readings of a board."""

import math
import sys
from contextlib import suppress

from rich.console import Group

from ..advice.advice import advice_for, streams
from ..advice.calibrated import finger_missing, next_step
from ..errors import BoardError
from ..link.board import Board
from ..link.frames import Touch
from ..link.lines import of_sensor
from ..link.replies import Hello
from .view import Judge, Pace, StripView, drawn, plain

PLAIN_LINES_PER_S = 4


def watch(board: Board, seconds: float | None, quiet: bool, judge: Judge | None = None) -> None:
    """Show a board's readings for a given time or until Ctrl-C.

    In a terminal, show a live picture; otherwise print lines. The time is that of `Board.now_s`.
    `judge` compares the readings with the true values, if these are known.
    """
    board.patience_s = math.inf
    with suppress(KeyboardInterrupt), drawn(not quiet) as display:
        board.stream(*(("touch", "spectrum") if display else streams(board.info)))
        infos = _infos(board)
        several = len(infos) > 1
        views = [
            StripView(info, f"{board.port}#{number}" if several else board.port)
            for number, info in enumerate(infos)
        ]
        advices = [advice_for(board, info, number) for number, info in enumerate(infos)]
        advising = not quiet and not next_step(infos[0])  # otherwise the command prints it
        missing = [finger_missing(info) or "" for info in infos]
        if advising and not display:
            for one in filter(None, dict.fromkeys(missing)):
                print(f"spots: {one}", file=sys.stderr)
        started_s = board.now_s()
        pace = Pace()
        paces = [Pace(PLAIN_LINES_PER_S) for _ in infos]

        def picture() -> Group:
            return Group(*(view.picture(board.stats, judge) for view in views))

        def show_state(state: str) -> None:
            for view in views:
                view.state = state
            if display:
                display.update(picture(), refresh=True)
            elif not quiet:
                print(f"{board.now_s() - started_s:8.3f} s  link {state}", flush=True)

        board.when_state_changes(show_state)
        for frame in board.frames(seconds):
            if frame.sensor >= len(views):
                continue
            now_s, view, advice = board.now_s(), views[frame.sensor], advices[frame.sensor]
            view.take(frame)
            if advising:
                (advice.take if display else advice.warn)(frame, now_s)
                view.advice = advice.sentence or missing[frame.sensor]
            if isinstance(frame, Touch):
                started_s = min(started_s, frame.time_s)  # a reading is older than its frame
                if judge is not None:
                    judge.take(frame, now_s)
            if display and pace.due(now_s):
                display.update(picture(), refresh=True)
            elif display or quiet or not isinstance(frame, Touch):
                continue
            elif paces[frame.sensor].due(now_s):
                strip = f"strip {frame.sensor}  " if several else ""
                print(strip + plain(frame, started_s, view.unit), flush=True)


def _infos(board: Board) -> list[Hello]:
    """Return the reply to ``hello`` of each strip.

    If the board refuses the command for a strip, return the first strip's reply instead.
    """
    infos = [board.command("hello")]
    for sensor in board.sensors[1:]:
        try:
            infos.append(board.command(of_sensor("hello", sensor)))
        except BoardError:
            infos.append(infos[0])
    return infos
