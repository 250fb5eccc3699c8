"""Computes keys, gestures and a gamepad's state from a board's readings, for the web UI."""

import contextlib
from collections.abc import Callable, Mapping, Sequence
from types import SimpleNamespace

from spots.advice.advice import advice_for
from spots.controller.controller import controller_for
from spots.controller.controller_settings import ControllerSettings
from spots.controller.controller_settings import load as load_controller
from spots.errors import SpotsError
from spots.keyboard.hosts import host_of_file
from spots.keyboard.key_engine import KeyEngine
from spots.keyboard.key_layout import KeyLayout, parts_of, typed
from spots.keyboard.reach import causes
from spots.link.board import Board
from spots.link.frames import Key, Spectrum, Touch
from spots.outputs.devices import AXIS_MAX
from spots.outputs.usages import name_of
from spots.terminal.view import flag_words
from spots.wearable import wearable
from spots.wearable.gestures import Gestures
from spots_device.board.settings import checksum
from spots_device.keys.layout import LIMITS, action, default_lines

from .state import PageState


class StripFeed:
    """Shows a board's readings in the web UI, with keys, gestures and gamepad computed from them.

    The parts ``touch``, ``keys``, ``stick`` and ``untrusted`` of the state are set, and events are
    added. If the board is not calibrated, only readings are shown. If the board itself is a
    keyboard, the layout only shows where the keys are that the board presses. ``draft()`` returns
    None, or a key layout to try in addition: a key that it would press is shown as an event
    ``tried``. A gesture is shown with the name of its key of `gestures`.
    """

    def __init__(
        self,
        board: Board,
        info: dict,
        state: PageState,
        layout: KeyLayout,
        controller: ControllerSettings | None = None,
        gestures: wearable.Mapping | None = None,
        draft: Callable[[], KeyLayout | None] = lambda: None,
    ):
        self._state, self._layout = state, layout
        self._does = gestures.pressed_by if gestures else lambda gesture: ""
        self._engine = self._gestures = self._controller = None
        self._own = info.get("keys")  # if true, the engine only tracks the layers
        self._advice, self._silent = advice_for(board, info), ""
        self._down: dict[tuple, tuple] = {}  # pressed keys: event of the press -> key in the layout
        self._shown: dict[str, object] = {}
        length_um = info.get("length_um")
        self._light = info.get("decay"), None, info.get("cross")  # arguments of `KeyEngine`
        if length_um:
            self._gestures = Gestures()
            with contextlib.suppress(SpotsError):  # the board is too slow for a gamepad
                settings = controller or load_controller()
                self._buttons = max((one.number for one in settings.button), default=0)
                self._controller = controller_for(board, settings)
            if not info["keys"] or _is_on(info, layout):
                sink = SimpleNamespace(key=lambda *event: None) if info["keys"] else self
                self._engine = KeyEngine(layout, length_um, sink, *self._light)
        engines = self._engine, self._gestures, self._controller
        self._engines = self._untried = [one for one in engines if one is not None]
        self._draft, self._tried, self._length_um = draft, None, length_um
        self.release()
        self._show()

    def take(self, touch: Touch, now_s: float, fingers: Sequence[float] = ()) -> None:
        """Process a reading, and show the result in the web UI.

        `now_s` is the time of its arrival by `Board.now_s`. `fingers` are positions in um that the
        board reported for this reading.
        """
        self._state.put("touch", _message(touch, now_s, fingers))
        self._advice.take(touch, now_s)
        self._silent = ""
        self._try()
        for engine in self._engines:
            found = engine.take(touch, now_s)
            for gesture in found if engine is self._gestures else ():
                self._state.add_event(
                    {"kind": "gesture", "does": self._does(gesture), **gesture._asdict()}
                )
        self._show()

    def _try(self) -> None:
        """If a browser edits a draft of the layout, compute pressed keys with this draft, too."""
        length_um = self._length_um
        draft = self._draft() if length_um else None
        if draft != self._tried:  # an equal draft that is sent again must not end a touch
            self._tried, self._engines = draft, self._untried
            if draft:
                trial = KeyEngine(
                    draft, length_um, SimpleNamespace(key=self._tried_key), *self._light
                )
                self._engines = [*self._untried, trial]

    def _tried_key(self, page: int, usage: int, modifiers: int, pressed: bool) -> None:
        self._state.add_event(
            {"kind": "tried", "name": key_name(page, usage, self._tried), "pressed": pressed}
        )

    def take_spectrum(self, spectrum: Spectrum, now_s: float) -> None:
        """Process the spectrum of the reading that `take` processed last."""
        self._advice.take(spectrum, now_s)

    def take_key(self, key: Key) -> None:
        """Show a key event from a board that is itself a keyboard; ignore it from other boards."""
        if self._own:
            self.key(key.page, key.usage, key.modifiers, key.pressed)

    def tick(self, now_s: float) -> None:
        """Update the timeouts of keys and gamepad; call this regularly, even without readings."""
        for engine in self._engines:
            engine.tick(now_s)
        self._show()

    def silence(self, sentence: str) -> None:
        """Show why no readings arrive (`sentence`), until the next reading."""
        if not self._silent:
            self.release()
            self._silent = sentence
            self._show()

    def release(self) -> None:
        """Release all keys and the gamepad; call this when the finger's state becomes unknown."""
        for engine in self._engines:
            engine.release()
        if self._own:
            self._down.clear()
        self._shown.clear()
        for name in ("touch", "keys", "stick", "untrusted"):
            self._state.put(name, None)

    def key(self, page: int, usage: int, modifiers: int, pressed: bool) -> None:
        """Show a key event in the web UI, with the key's zone in the layout.

        The modifiers are those that are down after the event.
        """
        event = page, usage
        if pressed:
            self._down[event] = self._place(page, usage, modifiers)
            layer, index = self._down[event]
        else:
            layer, index = self._down.pop(event, (None, None))
        what = {"name": key_name(page, usage, self._layout), "layer": layer, "index": index}
        self._state.add_event({"kind": "key", "pressed": pressed, **what})
        self._show()

    def _place(self, page: int, usage: int, modifiers: int) -> tuple[str | None, int | None]:
        """Return layer and index of the key that presses a usage, preferably with its modifiers."""
        if self._engine is None:
            return None, None
        layers = self._layout.layers
        found = None, None
        for layer in (self._engine.layer, *layers):
            for index, key in enumerate(layers[layer]):
                for slot in key.actions.values():
                    for one in causes(slot, self._layout.behaviours):
                        if one == action(page, usage, modifiers):
                            return layer, index
                        if parts_of(one)[:2] == (page, usage) and found == (None, None):
                            found = layer, index
        return found

    def _show(self) -> None:
        parts = {
            "keys": self._engine and self._keys(),
            "stick": self._controller and self._stick(),
            "untrusted": self._silent or self._advice.sentence,
        }
        for name, value in parts.items():
            if value != self._shown.get(name):
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
            "buttons": [bool(buttons >> i & 1) for i in range(self._buttons)],
            "held": self._controller.held,
        }


def key_name(page: int, usage: int, layout: KeyLayout | None = None) -> str:
    """Return the name of a key in the web UI: what the host of a layout types with it."""
    host = layout and host_of_file(layout.content)
    return typed(page, usage, host) or name_of(page, usage).lower().replace("_", " ")


def stored_layout(info: Mapping, layout: KeyLayout) -> str:
    """Return ``this`` if a board stores `layout`, ``default`` if it stores none, else ``other``."""
    stored = info.get("layout")
    if stored is None:
        return "default"
    return "this" if stored == checksum(layout.lines) else "other"


def _is_on(info: Mapping, layout: KeyLayout) -> bool:
    """Return whether a board uses a layout, according to `info`, the board's ``hello`` reply."""
    zones = [line for line in layout.lines if line.split()[0] not in LIMITS]
    stored = stored_layout(info, layout)
    return stored == "this" or (stored == "default" and zones == default_lines())


def layout_shown(layout: KeyLayout) -> dict:
    """Return a layout as a dict for the web UI.

    ``name``: name of the layout. ``layers``: for each layer by name, a list of its keys. Each key
    has a ``label``, and ``low`` and ``high``: the bounds of its zone as shares of the strip.
    """
    return {
        "name": layout.name,
        "layers": {
            name: [{"low": key.low, "high": key.high, "label": key.label} for key in keys]
            for name, keys in layout.layers.items()
        },
    }


def _message(touch: Touch, now_s: float, fingers: Sequence[float] = ()) -> dict:
    names = "time_s", "contrast", "brightness", "position_um", "sigma_um", "force_mN"
    names += "touching", "trusted"
    shown = {name: getattr(touch, name) for name in names}
    return {**shown, "arrived_s": now_s, "flags": flag_words(touch), "fingers": fingers}
