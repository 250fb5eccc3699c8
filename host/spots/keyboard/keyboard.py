"""``spots keyboard``: touches on a strip press keys of this computer."""

import argparse
import math
import sys
from functools import partial

from ..advice.calibrated import hello_often, run_engine
from ..common.signals import released_by_signals
from ..errors import BoardError, SettingError
from ..link.board import Board
from ..link.timeouts import RELEASE_S
from ..outputs.devices import Keyboard
from ..outputs.open import open_keyboard
from ..terminal.opening import open_announced
from .hosts import host_of_file
from .key_engine import KeyEngine
from .key_layout import KeyLayout, typed
from .layout import load

_TICK_S = 0.02
_BY_CHARACTER = "us"  # host of the keyboard that `outputs.desktop` presses


def keyboard_command(options: argparse.Namespace) -> None:
    """Run ``spots keyboard`` with the options that `cli` parsed."""
    layout = load(options.layout)
    if layout.on_board:
        raise SettingError(
            f"layout {options.layout}: only a board can press {layout.on_board[0]}: run "
            f"'spots keys push {options.layout}'"
        )
    host = layout.content.get("host", _BY_CHARACTER)
    if host != _BY_CHARACTER and not options.dry_run and not sys.platform.startswith("linux"):
        raise SettingError(
            f"layout {options.layout}: on this system, 'spots keyboard' presses keys by the "
            f"characters of an American keyboard, not those of the host '{host}': let the board be "
            "the keyboard ('spots keys push')"
        )
    with released_by_signals(), open_announced(options) as board:
        info = board.command("hello")
        if info["keys"] and not options.dry_run:
            raise BoardError(
                "the board is a keyboard itself, so each key would be typed twice: run "
                "'spots command set keys=0' first",
                "is_keyboard",
            )
        own = host_of_file(layout.content)
        cap = None if own is None else partial(typed, host=own)
        with open_keyboard(options.dry_run, cap) as keyboard:
            type_on(board, layout, keyboard, options.seconds)


def type_on(
    board: Board, layout: KeyLayout, keyboard: Keyboard, seconds: float | None = None
) -> None:
    """Press this computer's keys when a strip is touched. Release all keys on every exit path.

    While the board is disconnected, no key is pressed; this function waits until it reconnects.
    `seconds` is by `Board.now_s`. BoardError if the board has no calibration, is too slow or
    refuses a command; SpotsError if the keyboard refuses events.
    """
    info = hello_often(board, RELEASE_S)
    engine = KeyEngine(layout, info["length_um"], keyboard, info["decay"], cross=info.get("cross"))
    board.patience_s = math.inf  # waits for a lost board, while `engine` holds no key
    try:
        for _ in run_engine(board, engine, seconds, _TICK_S):
            pass
    finally:
        engine.release()
