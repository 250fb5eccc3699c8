"""Mod-morph: another action while a modifier is down. Imported only if the layout uses it.

The modifier is hidden from the key that the morphed action presses, until another key is pressed;
from a layer, a modifier or a sticky key until the switch is released.
"""

from .. import const
from ..usb.usages import KEYBOARD, MODIFIERS_FROM
from .layout import BEHAVIOUR, STICKY

_NONE = const(-1)


class Morph:
    """Mod-morphs of an `engine.Engine`."""

    def __init__(self, engine):
        self._engine = engine
        self._of = _NONE  # switch whose action hides modifiers

    def press(self, i, n, t):
        """Press the behaviour at the index `n` with the switch `i`."""
        b = self._engine.layout.behaviours
        if self._engine.merger.held() & b[n + 1]:
            self._hide(i, n)
            n += 1
        self._engine.then(i, b[n + 3], t)

    def _hide(self, i, n):
        engine = self._engine
        b = engine.layout.behaviours
        bits = b[n + 1] & ~b[n + 2]
        if self._stays(b[n + 4]):
            self._of = i
            engine.merger.mask(engine.sink, bits)
        else:
            engine.hidden = bits

    def released(self, i):
        """The switch `i` was released."""
        if self._of == i:
            self._of = _NONE
            self._engine.merger.mask(self._engine.sink, 0)

    def _stays(self, action):
        layout = self._engine.layout
        if action >> 20 == BEHAVIOUR:
            return layout.behaviours[layout.behaviour(action & 0xFFF)] == STICKY
        return action >> 20 < KEYBOARD or (
            action >> 20 == KEYBOARD and action & 0xFFF >= MODIFIERS_FROM
        )
