"""Texts and macros: keys that are pressed one after the other. Imported only if the layout uses it.

A text presses a key when the outbox has room for its reports. Events of switches wait until its
end. Modifiers that are down before it are released for its time. A step has 16 bits, see `layout`.
"""

from .. import const
from .layout import CONSUMER, KEYBOARD, MEDIA_FROM, NEXT_BITS
from .switch import past

_AT_ONCE = const(5)  # most steps between two readings; with USB HID, the outbox has room for five
_ALL = const(0xFF)  # all modifiers


class Text:
    """The text that an `engine.Engine` types; there is one at a time.

    Attributes
    ----------
    busy : bool
        Whether the text is not at its end.
    """

    def __init__(self, engine):
        self._engine = engine
        self.busy = False
        self._next = self._end = 0  # indices in the steps of the layout
        self._down = self._bits = self._masked = self._drops = 0
        self._t = self._since = self._wait_t = self._left = 0

    def press(self, n):
        """Begin with the text of the behaviour at the index `n`."""
        engine = self._engine
        b = engine.layout.behaviours
        self._next = b[n + 1]
        self._end = self._next + b[n + 2]
        self._bits = self._wait_t = 0
        self._drops = engine.merger.drops
        self._masked = engine.merger.masked
        self.busy = True
        engine.merger.mask(engine.sink, _ALL)

    def tick(self, t):
        """Allow steps at the time `t` in ticks."""
        self._t = t
        self._left = _AT_ONCE
        if self._engine.merger.drops != self._drops:  # the computer reads no reports
            self.forget()

    def step(self):
        """Process the next step; return False if it must wait for the next `tick`."""
        if not self._left or past(self._since, self._t) < self._wait_t:
            return False
        self._wait_t = 0
        self._left -= 1
        if self._next == self._end:
            self.forget()
        elif self._type(self._engine.layout.steps[self._next]):
            self._next += 1
        return True

    def forget(self):
        """End the text; all its keys are up then."""
        engine = self._engine
        if self._down:
            engine.merger.release(engine.sink, self._down)
            self._down = 0
        if self.busy:
            self.busy = False
            engine.merger.mask(engine.sink, self._masked)

    def _type(self, step):
        # Returns False if the step must be repeated, because too many keys are pressed.
        usage = step & 0xFF
        bits = step >> 8
        if not usage:
            self._since = self._t
            self._wait_t = bits * 1250 >> 7  # in units of 10 ms
            return True
        if usage == NEXT_BITS:
            self._bits = bits
            return True
        if usage >= MEDIA_FROM:
            return self._click(CONSUMER << 20 | self._bits << 12 | (usage - MEDIA_FROM) << 8 | bits)
        return self._click(KEYBOARD << 20 | bits << 12 | usage)

    def _click(self, action):
        engine = self._engine
        self._down = action  # first: an interrupt in between must not hide a pressed key
        if not engine.merger.press(engine.sink, action):
            self._down = 0
            return False
        engine.merger.release(engine.sink, action)
        self._down = self._bits = 0
        return True
