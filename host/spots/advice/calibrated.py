"""Checks that a board is calibrated and fast enough; feeds its readings to an application's engine.

An engine turns readings into results, such as key events.
"""

import contextlib
import math
from collections.abc import Iterator, Mapping
from typing import Any

from ..common.signals import resumed
from ..errors import BoardError, SpotsError
from ..link.board import Board
from ..link.board_errors import in_words
from ..link.frames import Touch
from ..link.replies import Hello
from .advice import advice_for, streams


def hello_calibrated(board: Board) -> Hello:
    """Return the reply to ``hello`` of a calibrated board.

    BoardError if the board has no calibration for its present settings, or its sensor does not
    answer.
    """
    info = board.command("hello")
    if not info.get("length_um"):
        if fault := sensor_fault(board):
            raise BoardError(f"the board on {board.port}: {fault}", "no_bus")
        raise BoardError(
            f"the board on {board.port} has no calibration for its settings: run 'spots calibrate'",
            "no_calibration",
        )
    return info


def sensor_fault(board: Board) -> str | None:
    """Return that the sensor of a board does not answer, and why; None if it does.

    Until it answers, the reply to ``hello`` has no calibration, although one may be stored.
    """
    try:
        fault = board.command("get")["fault"]
    except BoardError:  # a recording
        return None
    return fault and f"the sensor does not answer: {fault}"


def next_step(info: Hello) -> str | None:
    """Return advice for the user if a reply to ``hello`` shows no calibration, else None."""
    return None if info.get("length_um") else "next: spots calibrate"


NO_FINGER = "calibrated with an indenter, not yet with a finger"


def finger_missing(info: Mapping[str, Any]) -> str | None:
    """Return advice if a finger will read wrong positions on a strip; None if none is needed.

    `info` is a reply to ``hello``.
    """
    return f"{NO_FINGER}; next: spots rezero" if info.get("presser") == "no_finger" else None


def start_fault(info: Hello) -> str:
    """Return what went wrong at the start of a board, and what to do; empty if nothing did.

    The board reports this in the reply to ``hello`` until the next ``save``.
    """
    faults = "; ".join(map(in_words, info.get("boot", ())))
    return faults and (
        f"at its start, the board found: {faults}; next: check its settings, calibrate or push the "
        "layout again if they are missing, and run 'spots command save'"
    )


def hello_often(
    board: Board, within_s: float, remedy: str = "set a shorter exposure_us or a smaller average"
) -> Hello:
    """Return the reply to ``hello`` of a board that is calibrated and fast enough.

    BoardError if its readings are further apart than `within_s`, or it has no calibration for its
    present settings. `remedy` is the advice in the first case.
    """
    info = hello_calibrated(board)
    every_s = info["exposure_us"] * info["average"] * 1e-6
    if every_s > within_s:
        raise BoardError(
            f"the board takes a reading every {every_s:g} s, but this application needs one every "
            f"{within_s:g} s: {remedy}",
            "too_slow",
        )
    return info


def run_engine(
    board: Board, engine: Any, seconds: float | None, tick_s: float
) -> Iterator[tuple[Touch | None, Any]]:
    """Feed the readings of a board to an engine, such as a `KeyEngine`; yield its results.

    The engine has ``take(touch, now_s)``, ``tick(now_s)``, called every `tick_s`, and
    ``release()``. Its attribute ``objects`` is the number of detected objects that are not fingers,
    which is reset to 0 here: the light at that moment becomes the board's baseline, which is
    subtracted from the light of a touch. When this process is resumed after Ctrl-Z, stale readings
    are dropped, and ``engine.release()`` is called. Advice is printed on stderr if readings are
    untrusted or probably wrong.

    The duration is by `Board.now_s`; the end of a recording also ends the iteration. Yielded are a
    reading of sensor 0, None for a tick, and what the engine returned.
    """
    advice = advice_for(board, board.info)
    board.command("stream " + " ".join(streams(board.info)))
    end_s = None if seconds is None else board.now_s() + seconds
    since_s = -math.inf
    frames = board.frames()
    while not board.ended and (end_s is None or board.now_s() < end_s):
        if resumed():
            engine.release()
            since_s = board.now_s()
        for frame in frames.within(tick_s):
            if frame.sensor or (frame.time_s or 0.0) < since_s:
                continue
            advice.warn(frame, board.now_s())
            if isinstance(frame, Touch):
                yield frame, engine.take(frame, board.now_s())
        yield None, engine.tick(board.now_s())
        if engine.objects and not board.read_only:
            with contextlib.suppress(SpotsError):  # a missing reply does not matter
                board.command("tare")
        engine.objects = 0
