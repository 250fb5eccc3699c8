"""``spots record``: records a board and shows the progress."""

import sys
import threading
from contextlib import suppress
from itertools import count

from rich.console import Console
from rich.text import Text

from spots_device.board.settings import checksum

from ..common import typed_ahead
from ..errors import CalibrationError, SpotsError, printable
from ..link.board import Board
from ..terminal.view import Display
from .recorder import Recorder


def record(
    board: Board,
    path: str,
    seconds: float | None,
    rotate_bytes: int | None,
    calibration: list[str] | None,
    marks: bool = False,
) -> None:
    """Record the data of a board, for a given time or until Ctrl-C; show progress on stderr.

    The time is that of `Board.now_s`; `rotate_bytes` is that of `Recorder`. `calibration` has
    lines to be stored in the recording; CalibrationError if they are not those that the board uses.
    With `marks`, each line of standard input marks its moment, see `Board.mark`. FileError if the
    file cannot be written.
    """
    if calibration is not None:
        used, name = board.command("hello")["calibration"], checksum(calibration)
        if name != used:
            uses = f"calibration {used}" if used else "no calibration"
            raise CalibrationError(
                f"the board uses {uses}, but the calibration file has {name}: name the file of the "
                "calibration that the board uses, or leave out --calibration"
            )
        board.calibration = calibration
    begun_s, frames = board.now_s(), 0
    with Recorder(board, path, rotate_bytes=rotate_bytes) as recorder:

        def line() -> str:
            paths, stats = recorder.paths, board.stats
            name = f"{paths[0]}" + (f" … {paths[-1].name}" if len(paths) > 1 else "")
            return printable(
                f"{name}: {board.now_s() - begun_s:.1f} s, {frames} frames, "
                f"{recorder.bytes / 1e6:.3f} MB, lost {stats.lost}, bad {stats.bad_crc}"
            )

        if marks:
            threading.Thread(target=_mark, args=(board,), daemon=True).start()
        try:
            console = Console(stderr=True)
            with Display(console=console, get_renderable=lambda: Text(line()), transient=True):
                board.stream("touch", "spectrum")
                for _ in board.frames(seconds):
                    frames += 1
        except KeyboardInterrupt:
            pass
        finally:
            recorder.stop()
            print(line(), file=sys.stderr)


def _mark(board: Board) -> None:
    # Until the end of the recording, or of standard input. An empty line gets a number.
    typed_ahead.drop(sys.stdin)
    with suppress(SpotsError, OSError, ValueError):
        for number in count(1):
            line = sys.stdin.readline()
            if not line:
                return
            text = line.strip()[:64] or f"mark {number}"
            board.mark(text)
            print(printable(f"marked: {text}"), file=sys.stderr)
