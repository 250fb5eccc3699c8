"""``spots record``."""

from __future__ import annotations

import sys
from pathlib import Path
from typing import NamedTuple

from spots_device.settings import checksum

from ..calibrate import calibration_file
from ..errors import SpotsError, printable
from ..link.board import Board
from ..terminal.view import Pace
from .recorder import Recorder

_LINES_PER_S = 4


class Given(NamedTuple):
    """The calibration that a board was given, and the file that has it."""

    path: str
    lines: list[str]


def read_calibration(path: str) -> Given:
    """Read a calibration file; SpotsError says what is wrong with it."""
    return Given(path, list(calibration_file.load(Path(path)).lines))


def record(
    board: Board,
    path: str,
    seconds: float | None,
    rotate_bytes: int | None,
    calibration: Given | None,
) -> None:
    """Record a board until the time is over or Ctrl-C.

    Parameters
    ----------
    board : Board
    path : str
        The file to make.
    seconds : float or None
        For how long; None for no end.
    rotate_bytes : int or None
        See `Board.record`.
    calibration : Given or None
        To have it in the recording.

    Raises
    ------
    SpotsError
        If the board uses another calibration, or the file cannot be made.
    """
    if calibration is not None:
        _check_used(board, calibration)
        board.calibration = calibration.lines
    with board.record(path, rotate_bytes=rotate_bytes) as recorder:
        progress = _Progress(board, recorder)
        try:
            board.command("stream touch spectrum")
            for _ in board.frames(seconds):
                progress.frame()
        except KeyboardInterrupt:
            pass
        finally:
            recorder.stop()
            progress.end()


class _Progress:
    def __init__(self, board: Board, recorder: Recorder):
        self._board, self._recorder = board, recorder
        self._begun_s = board.now_s()
        self._pace = Pace(_LINES_PER_S)
        self._drawing = sys.stderr.isatty()
        self._frames = 0

    def frame(self) -> None:
        self._frames += 1
        if self._drawing and self._pace.due(self._board.now_s()):
            print("\r" + self._line(), end="", file=sys.stderr, flush=True)

    def end(self) -> None:
        start = "\r" if self._drawing else ""
        print(start + self._line(), file=sys.stderr)

    def _line(self) -> str:
        paths, stats = self._recorder.paths, self._board.stats
        name = printable(f"{paths[0]}" + (f" … {paths[-1].name}" if len(paths) > 1 else ""))
        seconds = self._board.now_s() - self._begun_s
        return (
            f"{name}: {seconds:.1f} s, {self._frames} frames, {self._recorder.bytes / 1e6:.3f} MB, "
            f"lost {stats.lost}, bad {stats.bad_crc}"
        )


def _check_used(board: Board, given: Given) -> None:
    used, name = board.command("hello")["calibration"], checksum(given.lines)
    if name != used:
        raise SpotsError(f"{given.path} is calibration {name}, the board uses {used}")
