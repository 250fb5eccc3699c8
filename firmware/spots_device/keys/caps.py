"""Caps word: letters are capitals until the end of a word. Imported only if the layout uses it."""

from .. import const
from .layout import KEYBOARD
from .merge import MODIFIERS_FROM

_SHIFT = const(0x2000)  # left shift in an action
_SHIFTS = const(0x22)  # left and right shift as modifiers
_LAST_LETTER = const(0x1D)
_LAST_DIGIT = const(0x27)
_BACKSPACE = const(0x2A)
_MINUS = const(0x2D)  # with shift it is the underscore
_DELETE = const(0x4C)


class CapsWord:
    """The caps word of an `engine.Engine`."""

    def __init__(self, engine):
        self._merger = engine.merger
        self.forget()

    def forget(self):
        """Switch it off."""
        self._on = False

    def press(self):
        """Switch it on or off."""
        self._on = not self._on

    def shifted(self, action):
        """Return the action of a key that is pressed; a key that ends the word switches it off."""
        if not self._on:
            return action
        usage = action & 0xFFF
        if action >> 20 != KEYBOARD:
            self._on = False
        elif usage <= _LAST_LETTER:
            return action | _SHIFT
        elif not (
            usage <= _LAST_DIGIT
            or usage in (_BACKSPACE, _DELETE)
            or usage >= MODIFIERS_FROM
            or (usage == _MINUS and (action >> 12 | self._merger.down) & _SHIFTS)
        ):
            self._on = False
        return action
