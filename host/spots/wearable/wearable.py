"""``spots wearable``: gestures on a strip worn on the body press keys of this computer."""

import argparse
from collections.abc import Callable
from pathlib import Path
from typing import Annotated

import msgspec

from ..advice.calibrated import hello_often, run_engine
from ..common import toml
from ..common.signals import released_by_signals
from ..errors import FileError, SettingError, SpotsError, did_you_mean
from ..link.board import Board
from ..link.timeouts import RELEASE_S
from ..outputs.devices import Keyboard
from ..outputs.open import open_keyboard
from ..outputs.usages import chord_of
from ..terminal.opening import open_announced
from ..terminal.view import Pace, drawn
from .gestures import NAMES, Gesture, Gestures
from .wearable_view import picture

FOLDER = Path(__file__).parent / "wearables"
DEFAULT = FOLDER / "media.toml"
_TICK_S = 0.02


class GesturesFile(toml.Strict):
    """Content of a gestures file, which assigns keys of the computer to gestures.

    Gestures with a lower confidence than `least_confidence` press no key.
    """

    gestures: dict[str, str]
    least_confidence: Annotated[float, msgspec.Meta(ge=0, le=1)] = 0.6


class Mapping:
    """Keys that the gestures press, read from a gestures file.

    `path` is a path, or the name of a file in the package; without `text`, the file is read.
    `names` has the names of the keys as in the file, `keys` their HID usage page, usage and
    modifier bits. FileError if the file does not exist or is invalid.
    """

    def __init__(self, path: str | Path = DEFAULT, text: str | None = None):
        if text is None:
            path, text = toml.find(path, FOLDER, "gestures")
        file = toml.checked(text, GesturesFile, "gestures", path)
        self.least_confidence = file.least_confidence
        self.names = file.gestures
        self.keys = {}
        for gesture, action in file.gestures.items():
            try:
                if gesture not in NAMES:
                    raise SettingError(f"no such gesture: {did_you_mean(gesture, NAMES)}")
                self.keys[gesture] = chord_of(action)
            except SpotsError as error:
                raise FileError(
                    f"gestures file {path}, {gesture}: {error}", path, f"gestures.{gesture}"
                ) from None

    def pressed_by(self, gesture: Gesture) -> str:
        """Return the name of the key that a gesture presses; empty if it presses none."""
        return (
            self.names.get(gesture.name, "") if gesture.confidence >= self.least_confidence else ""
        )

    def do(self, gesture: Gesture, keyboard: Keyboard) -> None:
        """Press and release the key of a gesture if the gesture's confidence is high enough."""
        if self.pressed_by(gesture):
            keyboard.click(*self.keys[gesture.name])


def wearable_command(options: argparse.Namespace) -> None:
    """Run ``spots wearable`` with the options that `cli` parsed."""
    mapping = Mapping(options.gestures or DEFAULT)
    dry_run = options.dry_run
    with (
        released_by_signals(),
        open_announced(options) as board,
        open_keyboard(dry_run) as keyboard,
    ):
        if dry_run:
            print(f"waiting for one of these gestures: {', '.join(mapping.names)}", flush=True)
        play(board, lambda one: mapping.do(one, keyboard), options.seconds, not dry_run, mapping)


def play(
    board: Board,
    on_gesture: Callable[[Gesture], None],
    seconds: float | None,
    drawing: bool,
    mapping: Mapping,
) -> list[Gesture]:
    """Read a board, and report each gesture when it is complete; return all gestures at the end.

    `seconds` is by `Board.now_s`. With `drawing`, a live picture shows the keys of the gestures.
    PortError if the board is lost, BoardError if it has no calibration or is too slow.
    """
    info, found = hello_often(board, RELEASE_S), []
    length_um = info["length_um"]
    engine = Gestures(length_um, info.get("decay"), info.get("cross"))
    pace, last = Pace(), None
    with drawn(drawing) as display:
        for touch, gestures in run_engine(board, engine, seconds, _TICK_S):
            last = touch or last
            for gesture in gestures or ():
                found.append(gesture)
                on_gesture(gesture)
            if touch is None and display and pace.due(board.now_s()):
                view = picture(last, length_um, found, mapping.names, board.stats)
                display.update(view, refresh=True)
    return found
