"""Tap dance: the number of taps on a key decides its action. Imported only if the layout uses it.

It is decided by the last possible tap, by the press of another key, or when no further tap comes in
time. If the key is then still held, its action is held, too. After a tap that has an action for a
hold, the key is this action if it is still held when the time ends.
"""

from .. import const
from .switch import past

_NONE = const(-1)


class Dance:
    """The tap dance of an `engine.Engine`; there is one at a time, because other keys end it."""

    def __init__(self, engine):
        self._engine = engine
        self.forget()

    def press(self, i, n, t):
        """Count a tap of the behaviour at the index `n` with the switch `i`."""
        self._engine.set_action(i, 0)
        if self._which != n:
            self._decide(t)
        self._which = n
        self._row = self._engine.row_of(i)
        self._of = i
        self._since = t
        self._taps += 1
        if self._is_last() and not self._hold():
            self._decide(t)

    def released(self, i, t):
        """The switch `i` was released."""
        if self._of == i:
            self._of = _NONE
            if self._is_last():
                self._decide(t)

    def beside(self, row, t):
        """The key `row` was pressed; return whether this decides a dance."""
        return row != self._row and self._decide(t)

    def tick(self, t):
        """Decide what gets no further tap; return whether there was something."""
        if self._taps and past(self._since, t) >= self._engine.layout.behaviours[self._which + 1]:
            hold = self._hold()
            if not hold or self._of < 0:
                return self._decide(t)
            i = self._of
            self.forget()
            self._engine.then(i, hold, t)
            return True
        return False

    def forget(self):
        """Drop a dance that is not decided."""
        self._which = self._row = self._of = _NONE
        self._taps = self._since = 0

    def _is_last(self):
        return self._taps == self._engine.layout.behaviours[self._which + 2]

    def _hold(self):
        # Returns the action of a hold after this number of taps, or 0.
        b = self._engine.layout.behaviours
        n = self._which
        return b[n + 2 + b[n + 2] + self._taps]

    def _decide(self, t):
        if not self._taps:
            return False
        engine = self._engine
        action = engine.layout.behaviours[self._which + 2 + self._taps]
        i = self._of
        self.forget()
        if i >= 0:
            engine.then(i, action, t)
        else:
            engine.click(action, t)
        return True
