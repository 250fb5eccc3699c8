"""Demonstrates controller, keyboard and wearable on a virtual board, and measures their errors."""

from __future__ import annotations

from collections.abc import Callable
from contextlib import suppress

from rich.console import Console

from spots.advice.calibrated import hello_calibrated
from spots.controller.controller import ControllerView, controller_for
from spots.controller.controller import play as play_gamepad
from spots.controller.controller_settings import load as load_settings
from spots.keyboard.hosts import host_of_file
from spots.keyboard.key_engine import KeyEngine
from spots.keyboard.keys import push
from spots.keyboard.layout import load as load_layout
from spots.link.board import Board
from spots.link.frames import Key, Touch
from spots.outputs.devices import Gamepad, PrintedGamepad
from spots.terminal.view import Pace, drawn
from spots.wearable.gestures import Gesture
from spots.wearable.wearable import Mapping, play

from ..measure.controller_score import ControllerScore
from ..measure.typing_score import TypingScore
from ..person.typist import TypedText
from ..strip.scenario import Scenario
from .typing_view import picture

DEMO_LAYOUT = "mini"
_PLAIN_LINES_PER_S = 4


def play_controller(
    board: Board, truth: Scenario, started_s: float, seconds: float | None, quiet: bool
) -> dict:
    """Run and show a controller without a gamepad device; return `ControllerScore.summary`.

    `started_s` is the host time at which the scenario's time is 0. `seconds` is measured with
    `Board.now_s`; None for no limit. SpotsError if the board is lost; so in the functions below.
    """
    settings = load_settings()
    controller = controller_for(board, settings)
    score = ControllerScore(settings, controller.length_um, truth, started_s)
    drawing = Console().is_terminal and not quiet
    gamepad: Gamepad = NoGamepad() if drawing or quiet else _Sampled(board.now_s)
    with (
        suppress(KeyboardInterrupt),
        gamepad,
        drawn(drawing) as display,
    ):
        view = ControllerView(board, controller, settings, display)
        play_gamepad(board, controller, gamepad, seconds, [score, view])
    return score.summary()


def type_on_board(
    board: Board,
    truth: Scenario,
    started_s: float,
    seconds: float | None,
    quiet: bool,
    layout_name: str = DEMO_LAYOUT,
    late_ms: list[float] | None = None,
) -> dict:
    """Show the text that is typed on a board's keys, and return the results of the run.

    The host also computes key events from the same readings (`KeyEngine`), and compares them with
    the key events of the board: ``host_agrees``. The latency of each correct press is added to
    `late_ms`, if given. The other results are those of `TypingScore.summary`.
    """
    layout = load_layout(layout_name)
    typed, here, there = TypedText(host_of_file(layout.content)), _Events(), _Events()
    push(board, layout)
    info = hello_calibrated(board)
    engine = KeyEngine(layout, info["length_um"], here, info["decay"], cross=info["cross"])
    board.command("stream touch")
    length_mm = engine.length_um / 1000
    score = TypingScore(truth.file, layout, length_mm, board.now_s() - started_s)
    drawing = Console().is_terminal and not quiet
    pace, touch = Pace(), None
    try:
        with drawn(drawing) as display:
            for frame in board.frames(seconds):
                if isinstance(frame, Touch):
                    touch = frame
                    engine.take(frame, board.now_s())
                elif isinstance(frame, Key):
                    there.key(*frame[3:7])
                    typed.key(*frame[3:7])
                    now_s = board.now_s() - started_s
                    score.key(frame.page, frame.usage, frame.pressed, now_s)
                    if frame.pressed and not drawing and not quiet:
                        print((typed.text.splitlines() or [""])[-1], flush=True)
                if drawing and pace.due(board.now_s()):
                    display.update(picture(layout, engine, touch, typed, board.stats), refresh=True)
    except KeyboardInterrupt:
        pass
    summary = score.summary(board.now_s() - started_s)
    if late_ms is not None:
        late_ms.extend(score.late_ms)
    return {
        "typed": typed.text,
        "presses": typed.presses,
        "keys_down": len(typed.down),
        "host_agrees": here.events == there.events,
        **summary,
    }


class _Events:
    def __init__(self):
        self.events = []

    def key(self, *event):
        self.events.append(event)


def show_gestures(board: Board, seconds: float | None, quiet: bool) -> dict:
    """Show the gestures that are recognised on a board's strip, and return their names.

    ``least_confidence`` is from 0 to 1; 0 without a gesture.
    """
    drawing = Console().is_terminal and not quiet
    mapping = Mapping()
    found: list[Gesture] = []

    def report(gesture: Gesture) -> None:
        found.append(gesture)
        if not drawing and not quiet:
            does = mapping.names.get(gesture.name, "-")
            print(f"{gesture.name:12} {gesture.confidence:4.0%}  {does}", flush=True)

    with suppress(KeyboardInterrupt):
        play(board, report, seconds, drawing, mapping)
    return {
        "gestures": [gesture.name for gesture in found],
        "least_confidence": round(min((gesture.confidence for gesture in found), default=0), 3),
    }


class NoGamepad(Gamepad):
    """Gamepad that discards all states."""

    def _send(self, state):
        pass


class _Sampled(PrintedGamepad):
    """Gamepad that prints only a few states per second."""

    def __init__(self, now_s: Callable[[], float]):
        super().__init__()
        self._now_s, self._pace = now_s, Pace(_PLAIN_LINES_PER_S)

    def _send(self, state):
        if self._pace.due(self._now_s()):
            super()._send(state)
