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
        self._engine.switches.action[i] = 0
        if self._which != n:
            self._decide(t)
        self._which = n
        self._row = self._engine.switches.row[i]
        self._of = i
        self._since = t
        self._taps += 1
        self._hidden |= self._engine.hidden
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
            if self._of >= 0 and self._hold():
                self._start(self._hold(), t)
                return True
            return self._decide(t)
        return False

    def forget(self):
        """Drop a dance that is not decided."""
        self._which = self._row = self._of = _NONE
        self._taps = self._since = self._hidden = 0

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
        self._start(self._engine.layout.behaviours[self._which + 2 + self._taps], t)
        return True

    def _start(self, action, t):
        engine = self._engine
        i = self._of
        row = self._row
        engine.hidden = self._hidden
        self.forget()
        if i >= 0:
            engine.then(i, action, t)
        else:
            engine.click(row, action, t)
