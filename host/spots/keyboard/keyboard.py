"""``spots keyboard``: touches to keys of this computer; and the demo of a board that types."""

from __future__ import annotations

import argparse
import math
from contextlib import nullcontext

from rich.console import Console

from spots_sim.typing_view import picture
from spots_sim.typist import TypedText

from ..errors import SpotsError
from ..link.board import Board
from ..link.calibrated import hello_often, length_of, tell_rest, ticks
from ..link.connect import open_named
from ..link.frames import Key, Touch
from ..outputs.devices import open_keyboard
from ..signals import released_by_signals
from ..terminal.view import Pace, live
from .key_engine import LOST_S, KeyEngine, KeySink
from .keys import push
from .layout import KeyLayout, load

_TICK_S = 0.02
DEMO_LAYOUT = "mini"


def run(options: argparse.Namespace) -> None:
    """Run ``spots keyboard`` with the options that `cli` parsed."""
    layout = load(options.layout)
    with released_by_signals(), open_named(options) as board:
        info = board.command("hello")
        if info["keys"]:
            raise SpotsError(
                "the board is a keyboard itself, and each key would come twice: "
                "'spots command keys off' first"
            )
        with open_keyboard(options.dry_run) as keyboard:
            type_on(board, layout, keyboard, options.seconds)


def type_on(
    board: Board, layout: KeyLayout, keyboard: KeySink, seconds: float | None = None
) -> None:
    """Type on a keyboard what is touched, until the time is over; then let go of all.

    Parameters
    ----------
    board : Board
    layout : KeyLayout
    keyboard : KeySink
    seconds : float, optional
        Never end, if not given.

    Raises
    ------
    SpotsError
        If the board has no calibration, is too slow or lost, or the keyboard takes no more.
    """
    length_um = hello_often(board, LOST_S)["length_um"]
    engine = KeyEngine(layout, length_um, keyboard)
    board.patience_s = math.inf  # no key is down meanwhile
    try:
        for touches in ticks(board, seconds, _TICK_S, engine.release):
            for touch in touches:
                engine.take(touch, board.now_s())
            engine.tick(board.now_s())
            if engine.rests:
                engine.rests = 0
                tell_rest(board)
    finally:
        engine.release()


def demonstrate(board: Board, seconds: float | None, quiet: bool) -> dict:
    """Let the board be the keyboard, show what it types, and return the run in figures.

    The same engine runs here on the same readings, and its events are compared.
    """
    layout = load(DEMO_LAYOUT)
    typed, here, there = TypedText(), _Events(), _Events()
    push(board, layout)
    engine = KeyEngine(layout, length_of(board), here)
    board.command("stream touch")
    console = Console()
    drawing = console.is_terminal and not quiet
    pace, touch = Pace(), None
    try:
        with live(console) if drawing else nullcontext() as display:
            for frame in board.frames(seconds):
                if isinstance(frame, Touch):
                    touch = frame
                    engine.take(frame, board.now_s())
                elif isinstance(frame, Key):
                    there.key(*frame[3:7])
                    typed.key(*frame[3:7])
                    if frame.pressed and not drawing and not quiet:
                        print((typed.text.splitlines() or [""])[-1], flush=True)
                if drawing and pace.due(board.now_s()):
                    display.update(picture(layout, engine, touch, typed, board.stats), refresh=True)
    except KeyboardInterrupt:
        pass
    return {
        "typed": typed.text,
        "presses": typed.presses,
        "keys_down": len(typed.down),
        "host_agrees": here.events == there.events,
    }


class _Events:
    def __init__(self):
        self.events = []

    def key(self, *event):
        self.events.append(event)
