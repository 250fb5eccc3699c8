"""What the uses make of a board's readings: keys, gestures and a stick, as parts of the page."""

from __future__ import annotations

import contextlib
from collections.abc import Iterator

from spots_device import decode
from spots_device.layout import action

from ..controller.controller import controller_for
from ..controller.controller_settings import load as load_controller
from ..errors import SpotsError
from ..keyboard.key_engine import KeyEngine
from ..keyboard.layout import KeyLayout
from ..link.board import Board
from ..link.frames import Key, Touch
from ..outputs.devices import AXIS_MAX
from ..outputs.usages import USAGES, name_of
from ..wearable.gestures import Gestures
from .state import State

_FLAG_WORDS = {
    decode.SATURATED: "saturated",
    decode.MISFIT: "not one press",
    decode.NOT_CALIBRATED: "not calibrated",
    decode.LED_OFF: "LED off",
}
_BUTTONS = 3


class Feel:
    """Takes readings and puts what they mean into a state.

    Parameters
    ----------
    board : Board
    info : dict
        Its ``hello``; without a calibration there is nothing but the readings.
    layout : KeyLayout
        Of keys; not used where the board is a keyboard itself.
    state : State
    """

    def __init__(self, board: Board, info: dict, layout: KeyLayout, state: State):
        self._board, self._state, self._layout = board, state, layout
        self._engine = self._gestures = self._controller = None
        self._down: dict[tuple, tuple] = {}  # by the event that will let it go
        self._shown_stick = None
        length_um = info.get("length_um")
        if length_um:
            self._gestures = Gestures()
            with contextlib.suppress(SpotsError):  # too slow for a stick
                self._controller = controller_for(board, load_controller())
            if not info["keys"]:
                self._engine = KeyEngine(layout, length_um, self)
        state.put("keys", None)
        state.put("stick", None)
        self._show_keys()
        self._show_stick()

    def take(self, touch: Touch, now_s: float) -> None:
        """Take a reading."""
        self._state.put("touch", _shown(touch, now_s))
        if self._gestures is None:
            return
        if self._engine:
            with self._shown_layer():
                self._engine.take(touch, now_s)
        for gesture in self._gestures.take(touch, now_s):
            self._state.tell({"kind": "gesture", **gesture._asdict()})
        if self._controller:
            self._controller.take(touch, now_s)
        self._show_stick()

    def take_key(self, key: Key) -> None:
        """Take a key of a board that is a keyboard itself."""
        if self._engine is None:
            self.key(key.page, key.usage, key.modifiers, key.pressed)

    def tick(self, now_s: float) -> None:
        """Let time pass, also when no reading comes."""
        if self._gestures is None:
            return
        if self._engine:
            with self._shown_layer():
                self._engine.tick(now_s)
        self._gestures.tick(now_s)
        if self._controller:
            self._controller.tick(now_s)
        self._show_stick()

    def release(self) -> None:
        """Let go of all: nobody knows of a finger any more."""
        if self._engine:
            self._engine.release()
        self._show_keys()
        self._shown_stick = None
        for name in ("touch", "stick"):
            self._state.put(name, None)

    def key(self, page: int, usage: int, modifiers: int, pressed: bool) -> None:
        """Tell of a key event, and which key of the layout it is."""
        event = page, usage, modifiers
        if pressed:
            self._down[event] = self._place(action(page, usage, modifiers))
        layer, index = self._down.get(event, (None, None))
        if not pressed:
            self._down.pop(event, None)
        name = _written(page, usage)
        self._state.tell(
            {"kind": "key", "name": name, "pressed": pressed, "layer": layer, "index": index}
        )
        self._show_keys()

    def _place(self, wanted: int) -> tuple[str | None, int | None]:
        if self._engine is None:
            return None, None
        layers = self._layout.layers
        for layer in (self._engine.layer, *layers):
            for index, key in enumerate(layers[layer]):
                if wanted in key.actions.values():
                    return layer, index
        return None, None

    @contextlib.contextmanager
    def _shown_layer(self) -> Iterator[None]:
        layer = self._engine.layer
        yield
        if self._engine.layer != layer:
            self._show_keys()

    def _show_keys(self) -> None:
        if self._engine is None:
            return
        down = [{"layer": layer, "index": index} for layer, index in self._down.values()]
        self._state.put("keys", {"layer": self._engine.layer, "down": down})

    def _show_stick(self) -> None:
        if self._controller is None:
            return
        x, y, z, buttons = self._controller.state
        stick = {
            "x": x / AXIS_MAX,
            "y": y / AXIS_MAX,
            "z": z / AXIS_MAX,
            "buttons": [bool(buttons >> i & 1) for i in range(_BUTTONS)],
            "held": self._controller.held,
        }
        if stick != self._shown_stick:
            self._shown_stick = stick
            self._state.put("stick", stick)


def _written(page: int, usage: int) -> str:
    """Return the character that a key writes, else its name."""
    known = USAGES.get((page, usage))
    character = known.pynput if known else None
    if character and len(character) == 1:
        return character.upper()
    return name_of(page, usage).lower().replace("_", " ")


def layout_shown(layout: KeyLayout) -> dict:
    """Return a layout as the page draws it."""
    return {
        "name": layout.name,
        "layers": {
            name: [{"low": key.low, "high": key.high, "label": key.label} for key in keys]
            for name, keys in layout.layers.items()
        },
    }


def _shown(touch: Touch, now_s: float) -> dict:
    return {
        "time_s": touch.time_s,
        "arrived_s": now_s,
        "contrast": touch.contrast,
        "brightness": touch.brightness,
        "position_um": touch.position_um,
        "force_mN": touch.force_mN,
        "touching": touch.touching,
        "trusted": touch.trusted,
        "flags": [word for flag, word in _FLAG_WORDS.items() if touch.flags & flag],
    }
