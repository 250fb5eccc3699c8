"""Caps word: letters are capitals until the end of a word. Imported only if the layout uses it.

What a key types depends on the computer, so the layout says what caps word does with it. Each of
the integers of a `CAPS_WORD` has a byte for each of three keys: the usages 0x04 to 0x38, then 0x64,
0x87 and 0x89. A byte has two bits for each level: no modifier, shift, AltGr, shift and AltGr. 0
ends the word, 1 leaves the key as it is, 2 adds shift.
"""

from .. import const
from ..usb.usages import KEYBOARD, MODIFIERS_FROM

_SHIFT = const(0x2000)  # left shift in an action
_SHIFTS = const(0x22)  # left and right shift as modifiers
_ALT_GR = const(0x40)
_FIRST = const(0x04)  # A
_LAST = const(0x38)  # slash
_BACKSPACE = const(0x2A)
_DELETE = const(0x4C)
_SHIFTED = const(2)


class Caps:
    """The caps word of an `engine.Engine`."""

    def __init__(self, engine):
        self._engine = engine
        self._n = 0
        self.forget()

    def forget(self):
        """Switch it off."""
        self._on = False

    def press(self, i, n, t):
        """Switch it on or off; `n` is the index of its behaviour."""
        self._n = n
        self._on = not self._on

    def shifted(self, action, down):
        """Return the action of a key that is pressed; a key that ends the word switches it off.

        `down` has the bits of the modifiers that are down beside those of the action.
        """
        usage = action & 0xFFF
        if not self._on or (action >> 20 == KEYBOARD and usage >= MODIFIERS_FROM):
            return action
        down |= action >> 12 & 0xFF
        if action >> 20 != KEYBOARD or down & ~(_SHIFTS | _ALT_GR):
            self._on = False
        elif usage not in (_BACKSPACE, _DELETE):
            what = self._what(usage)
            if down & _SHIFTS:
                what >>= 2
            if down & _ALT_GR:
                what >>= 4
            if not what & 3:
                self._on = False
            elif what & _SHIFTED:
                return action | _SHIFT
        return action

    def _what(self, usage):
        # Returns the byte of a key.
        if _FIRST <= usage <= _LAST:
            i = usage - _FIRST
        elif usage == 0x64:
            i = 53
        elif usage in (0x87, 0x89):
            i = 54 + (usage - 0x87 >> 1)
        else:
            return 0
        return self._engine.layout.behaviours[self._n + 1 + i // 3] >> i % 3 * 8
