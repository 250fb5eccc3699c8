"""Key repeat: presses the last key again. Imported only if the layout uses it."""

from ..usb.usages import KEYBOARD
from .layout import BEHAVIOUR


class Repeat:
    """The key repeat of an `engine.Engine`."""

    def __init__(self, engine):
        self._engine = engine
        self._last = 0

    def pressed(self, action):
        """Remember a text, or a key with all modifiers that are down."""
        if action >> 20 == KEYBOARD:
            self._last = action | self._engine.merger.down << 12
        elif action >> 20 == BEHAVIOUR:
            self._last = action

    def press(self, i, n, t):
        """Press the last key with the switch `i`."""
        self._engine.then(i, self._last, t)
