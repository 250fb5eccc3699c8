"""``spots controller``: a board's readings to a gamepad, until one has played enough."""

from __future__ import annotations

import argparse
from collections.abc import Callable
from contextlib import nullcontext
from typing import Protocol

import msgspec
from rich.console import Console
from rich.panel import Panel

from ..errors import SpotsError
from ..link.board import Board
from ..link.calibrated import hello_often, ticks
from ..link.connect import open_named
from ..link.frames import Touch
from ..outputs.devices import Gamepad, State
from ..outputs.open import open_gamepad
from ..signals import released_by_signals
from ..terminal.view import Pace, live
from .controller_settings import DEFAULT, Settings, load
from .controller_setup import set_up
from .gamepad_engine import Controller
from .stick import picture

_TICK_S = 0.005  # how late a state may be that no reading asks for
_READINGS_BRIDGED = 1.5


def controller_command(options: argparse.Namespace) -> None:
    """Run ``spots controller`` with the options that `cli` parsed."""
    settings = None if options.calibrate else load(options.settings or DEFAULT)
    with released_by_signals(), open_named(options) as board:
        if settings is None:
            set_up(board, options.settings or "controller.toml")
            return
        controller = controller_for(board, settings)
        if board.info["gamepad"] and not options.dry_run:
            raise SpotsError(
                "the board is a gamepad itself, and every touch would count twice: "
                "'spots command gamepad off' first"
            )
        drawing = Console().is_terminal and not options.dry_run
        view = ControllerView(board, controller, settings) if drawing else None
        with open_gamepad(options.dry_run) as gamepad:
            show(board, controller, gamepad, options.seconds, view)


def play(
    board: Board,
    controller: Controller,
    gamepad: Gamepad,
    seconds: float | None = None,
    on_reading: Callable[[Touch], None] | None = None,
    on_state: Callable[[State], None] | None = None,
) -> None:
    """Play a gamepad from a board's first strip.

    Parameters
    ----------
    board : Board
        Told to follow the light of the untouched strip.
    controller : Controller
    gamepad : Gamepad
        The caller lets it go, whatever ends this.
    seconds : float, optional
        End after so long; never, if not given.
    on_reading, on_state : callable, optional
        Told of each reading after it was taken, and of each state before it is sent.

    Raises
    ------
    SpotsError
        If the board is lost, or the gamepad takes no more.
    """

    def send(state: State | None) -> None:
        if state is not None:
            if on_state:
                on_state(state)
            gamepad.update(*state)

    for touches in ticks(board, seconds, _TICK_S, controller.release):
        for touch in touches:
            send(controller.take(touch, board.now_s()))
            if on_reading:
                on_reading(touch)
        send(controller.tick(board.now_s()))


def controller_for(board: Board, settings: Settings) -> Controller:
    """Return a controller for a board's strip.

    It bridges at least one reading that failed, within ``hold_ms``.

    Raises
    ------
    SpotsError
        If the board has no calibration, or its readings come less often than ``hold_ms``.
    """
    info = hello_often(
        board,
        settings.hold_ms / 1000,
        "set a shorter exposure_us or a smaller average, or a longer hold_ms in the settings",
    )
    every_ms = info["exposure_us"] * info["average"] / 1000
    patient = msgspec.structs.replace(
        settings, release_ms=max(settings.release_ms, _READINGS_BRIDGED * every_ms)
    )
    return Controller(patient, info["length_um"])


class Judge(Protocol):
    """Who knows the truth of a run and compares states with it."""

    def read(self, touch: Touch, state: State) -> None:
        """Compare the state after a reading."""

    def sent(self, state: State, now_s: float) -> None:
        """Count a state that is sent."""


class ControllerView:
    """The picture of a controller that is being played."""

    def __init__(self, board: Board, controller: Controller, settings: Settings):
        self._board, self._controller = board, controller
        self._buttons = max((one.number for one in settings.button), default=0)
        info = board.info
        self._title = f"SPOTS controller  {info['board']} · {info['runtime']} · {board.port}"
        self.states = 0

    def sent(self, state: State) -> None:
        """Count a state that is sent."""
        self.states += 1

    def picture(self) -> Panel:
        """Return the picture as it is now."""
        stats = self._board.stats
        facts = f"states {self.states}   frames {stats.frames}   lost {stats.lost}"
        controller = self._controller
        return picture(controller.state, controller.held, self._buttons, self._title, facts)


def show(
    board: Board,
    controller: Controller,
    gamepad: Gamepad,
    seconds: float | None,
    view: ControllerView | None = None,
    judge: Judge | None = None,
) -> None:
    """Play as `play` does, with a picture."""
    pace = Pace()
    with live(Console()) if view else nullcontext() as display:

        def on_reading(touch):
            if judge:
                judge.read(touch, controller.state)
            if view and pace.due(board.now_s()):
                display.update(view.picture(), refresh=True)

        def on_state(state):
            if judge:
                judge.sent(state, board.now_s())
            if view:
                view.sent(state)

        play(board, controller, gamepad, seconds, on_reading, on_state)
