"""Keys, gestures and a stick from a board's readings, as parts of the page."""

from __future__ import annotations

import contextlib

from spots_device.layout import action

from ..controller.controller import controller_for
from ..controller.controller_settings import load as load_controller
from ..errors import SpotsError
from ..keyboard.key_engine import KeyEngine
from ..keyboard.layout import KeyLayout, typed
from ..link.board import Board
from ..link.frames import Key, Touch
from ..link.untrusted import Untrusted
from ..outputs.devices import AXIS_MAX
from ..outputs.usages import name_of
from ..terminal.view import flag_words
from ..wearable.gestures import Gestures
from .state import PageState

_BUTTONS = 3


class Feel:
    """Runs the applications on readings and puts their output into a state.

    Parameters
    ----------
    board : Board
    info : dict
        Its ``hello``; without a calibration there is nothing but the readings.
    layout : KeyLayout
        Of keys; not used where the board is a keyboard itself.
    state : PageState
    """

    def __init__(self, board: Board, info: dict, layout: KeyLayout, state: PageState):
        self._state, self._layout = state, layout
        self._engine = self._gestures = self._controller = None
        self._down: dict[tuple, tuple] = {}  # by the event that will release it
        self._shown: dict[str, dict] = {}
        length_um = info.get("length_um")
        if length_um:
            self._gestures = Gestures()
            with contextlib.suppress(SpotsError):  # too slow for a stick
                self._controller = controller_for(board, load_controller())
            if not info["keys"]:
                self._engine = KeyEngine(layout, length_um, self)
        engines = self._engine, self._gestures, self._controller
        self._engines = [one for one in engines if one is not None]
        self._untrusted = Untrusted()
        state.put("keys", None)
        state.put("stick", None)
        self._show()

    def take(self, touch: Touch, now_s: float) -> None:
        """Take a reading and update the state.

        Parameters
        ----------
        touch : Touch
            The readings of one strip, in order.
        now_s : float
            When it arrived, in seconds by the link's clock.
        """
        self._state.put("touch", _message(touch, now_s))
        self._untrusted.take(touch, now_s)
        for engine in self._engines:
            found = engine.take(touch, now_s)
            for gesture in found if engine is self._gestures else ():
                self._state.add_event({"kind": "gesture", **gesture._asdict()})
        self._show()

    def take_key(self, key: Key) -> None:
        """Take a key of a board that is a keyboard itself."""
        if self._engine is None:
            self.key(key.page, key.usage, key.modifiers, key.pressed)

    def tick(self, now_s: float) -> None:
        """Let time pass, also when no reading comes."""
        for engine in self._engines:
            engine.tick(now_s)
        self._show()

    def release(self) -> None:
        """Release all keys and the stick: where the finger is, is unknown."""
        if self._engine:
            self._engine.release()
        self._shown.clear()
        for name in ("touch", "keys", "stick", "untrusted"):
            self._state.put(name, None)

    def key(self, page: int, usage: int, modifiers: int, pressed: bool) -> None:
        """Add a key event, and mark which key of the layout it is."""
        event = page, usage, modifiers
        if pressed:
            self._down[event] = self._place(action(*event))
            layer, index = self._down[event]
        else:
            layer, index = self._down.pop(event, (None, None))
        name = typed(page, usage) or name_of(page, usage).lower().replace("_", " ")
        self._state.add_event(
            {"kind": "key", "name": name, "pressed": pressed, "layer": layer, "index": index}
        )
        self._show()

    def _place(self, wanted: int) -> tuple[str | None, int | None]:
        if self._engine is None:
            return None, None
        layers = self._layout.layers
        for layer in (self._engine.layer, *layers):
            for index, key in enumerate(layers[layer]):
                if wanted in key.actions.values():
                    return layer, index
        return None, None

    def _show(self) -> None:
        """Put the parts that have changed."""
        for name, engine, part in (
            ("keys", self._engine, self._keys),
            ("stick", self._controller, self._stick),
            ("untrusted", self._untrusted, lambda: self._untrusted.sentence),
        ):
            if engine is not None and (value := part()) != self._shown.get(name):
                self._shown[name] = value
                self._state.put(name, value)

    def _keys(self) -> dict:
        down = [{"layer": layer, "index": index} for layer, index in self._down.values()]
        return {"layer": self._engine.layer, "down": down}

    def _stick(self) -> dict:
        x, y, z, buttons = self._controller.state
        return {
            "x": x / AXIS_MAX,
            "y": y / AXIS_MAX,
            "z": z / AXIS_MAX,
            "buttons": [bool(buttons >> i & 1) for i in range(_BUTTONS)],
            "held": self._controller.held,
        }


def layout_shown(layout: KeyLayout) -> dict:
    """Return a layout as the page draws it."""
    return {
        "name": layout.name,
        "layers": {
            name: [{"low": key.low, "high": key.high, "label": key.label} for key in keys]
            for name, keys in layout.layers.items()
        },
    }


def _message(touch: Touch, now_s: float) -> dict:
    return {
        "time_s": touch.time_s,
        "arrived_s": now_s,
        "contrast": touch.contrast,
        "brightness": touch.brightness,
        "position_um": touch.position_um,
        "force_mN": touch.force_mN,
        "touching": touch.touching,
        "trusted": touch.trusted,
        "flags": flag_words(touch),
    }
