"""``spots controller``: uses a strip as a gamepad of this computer."""

import argparse
from collections.abc import Sequence
from pathlib import Path
from typing import Protocol

import msgspec
from rich.live import Live
from rich.panel import Panel

from ..advice.calibrated import hello_often, run_engine
from ..common.atomic import check_writable
from ..common.signals import released_by_signals
from ..errors import BoardError
from ..link.board import Board
from ..link.frames import Touch
from ..outputs.devices import Gamepad, State
from ..outputs.open import open_gamepad
from ..terminal.opening import open_announced
from ..terminal.view import Pace, drawn
from .controller_settings import DEFAULT, KIND, ControllerSettings, load
from .controller_setup import set_up
from .gamepad_engine import Controller
from .stick import picture

_NEW = "controller.toml"  # settings file of ``--calibrate``, if none is named
_TICK_S = 0.005  # largest delay of a state that a timeout changes
_READINGS_BRIDGED = 1.5  # least `release_ms`, as a multiple of the time between two readings


def controller_command(options: argparse.Namespace) -> None:
    """Run ``spots controller`` with the options that `cli` parsed."""
    settings = None if options.calibrate else load(options.settings or DEFAULT)
    if settings is None:
        check_writable(Path(options.settings or _NEW), KIND)
    with released_by_signals(), open_announced(options) as board:
        if settings is None:
            set_up(board, options.settings or _NEW)
            return
        controller = controller_for(board, settings)
        if board.info["gamepad"] and not options.dry_run:
            raise BoardError(
                "the board is a gamepad itself, so each touch would count twice: run "
                "'spots command set gamepad=0' first",
                "is_gamepad",
            )
        dry_run = options.dry_run
        with open_gamepad(dry_run) as gamepad, drawn(not dry_run) as display:
            view = ControllerView(board, controller, settings, display)
            play(board, controller, gamepad, options.seconds, [view])


class Watcher(Protocol):
    """Observer of the readings and gamepad states of `play`."""

    def read(self, touch: Touch, state: State) -> None:
        """Handle a reading, and the state that the controller computed from it."""

    def sent(self, state: State, now_s: float) -> None:
        """Handle a state just before it is sent to the gamepad, at a time of `Board.now_s`."""


def play(
    board: Board,
    controller: Controller,
    gamepad: Gamepad,
    seconds: float | None = None,
    watchers: Sequence[Watcher] = (),
) -> None:
    """Control a gamepad with the readings of a board.

    Parameters
    ----------
    board : Board
        Board with a calibrated strip.
    controller : Controller
        Controller that computes the states.
    gamepad : Gamepad
        Gamepad that gets the states. The caller must close the gamepad, which releases all inputs.
    seconds : float, optional
        Time after which this function ends, in seconds of `Board.now_s`; no limit if not given.
        The end of a recording also ends this function.
    watchers : sequence of Watcher, optional
        Observers of the readings and the states.

    Raises
    ------
    SpotsError
        If the board is lost, or the gamepad refuses events.
    """
    for touch, state in run_engine(board, controller, seconds, _TICK_S):
        if state is not None:
            for watcher in watchers:
                watcher.sent(state, board.now_s())
            gamepad.update(*state)
        if touch is not None:
            for watcher in watchers:
                watcher.read(touch, controller.state)


def controller_for(board: Board, settings: ControllerSettings) -> Controller:
    """Return a controller for the strip of a board.

    If necessary, ``release_ms`` is increased, so that a single reading that is too dark does not
    end a touch.

    Parameters
    ----------
    board : Board
        Board with a calibrated strip.
    settings : ControllerSettings
        Axes, buttons and timeouts.

    Returns
    -------
    Controller

    Raises
    ------
    BoardError
        If the board has no calibration (``why`` is "no_calibration"), or the time between its
        readings is longer than ``hold_ms`` ("too_slow").
    """
    remedy = "set a shorter exposure_us or a smaller average, or a longer hold_ms in the settings"
    info = hello_often(board, settings.hold_ms / 1000, remedy)
    every_ms = info["exposure_us"] * info["average"] / 1000
    release_ms = max(settings.release_ms, _READINGS_BRIDGED * every_ms)
    settings = msgspec.structs.replace(settings, release_ms=release_ms)
    return Controller(settings, info["length_um"], info.get("decay"), info.get("cross"))


class ControllerView:
    """Draws the state of a controller while `play` runs; a `Watcher`.

    Parameters
    ----------
    board : Board
        Board that sends the readings. Its name and its link statistics are shown.
    controller : Controller
        Controller to draw.
    settings : ControllerSettings
        Settings of the controller, for the number of buttons.
    display : rich.live.Live or None
        Live display to update; None if the caller uses only `picture`.
    """

    def __init__(
        self,
        board: Board,
        controller: Controller,
        settings: ControllerSettings,
        display: Live | None = None,
    ):
        self._board, self._controller, self._display = board, controller, display
        self._buttons = max((one.number for one in settings.button), default=0)
        info = board.info
        self._title = f"SPOTS controller  {info['board']} · {info['runtime']} · {board.port}"
        self._states, self._pace = 0, Pace()

    def read(self, touch: Touch, state: State) -> None:
        if self._display and self._pace.due(self._board.now_s()):
            self._display.update(self.picture(), refresh=True)

    def sent(self, state: State, now_s: float) -> None:
        self._states += 1

    def picture(self) -> Panel:
        """Return a picture of the controller's present state, for a terminal."""
        stats = self._board.stats
        facts = f"states {self._states}   frames {stats.frames}   lost {stats.lost}"
        controller = self._controller
        return picture(controller.state, controller.held, self._buttons, self._title, facts)
