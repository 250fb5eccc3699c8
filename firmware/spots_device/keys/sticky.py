"""Sticky keys and layers: after a tap they are down until the next key is pressed.

While its switch is held, a sticky key is an ordinary key. A modifier ends a sticky layer, but no
sticky key, so several sticky modifiers combine. Imported only if the layout uses it.
"""

from array import array

from .. import const
from .layout import MOMENTARY
from .switch import past

_MOST = const(4)  # sticky at the same time
_NONE = const(-1)


class Sticky:
    """Sticky keys and layers of an `engine.Engine`."""

    def __init__(self, engine):
        self._engine = engine
        self._which = array("i", (_NONE,) * _MOST)  # index of the behaviour in the layout
        self._of = array("i", (_NONE,) * _MOST)  # switch that holds it, or -1
        self._since = array("i", bytes(4 * _MOST))  # ticks: when its switch was released
        self._used = bytearray(_MOST)  # whether a key was pressed while its switch was held

    def press(self, i, n, t):
        """Press the behaviour at the index `n` with the switch `i`."""
        free = _NONE
        for k in range(_MOST):
            if self._which[k] == n and self._of[k] < 0:
                self._finish(k)
            if self._which[k] < 0 and free < 0:
                free = k
        if free >= 0:
            if not self._is_layer(n):
                self.pressed(True)
            self._which[free] = n
            self._of[free] = i
            self._used[free] = False
            self._change(n, 1)

    def release(self, i, t):
        """Release the switch `i`."""
        for k in range(_MOST):
            if self._which[k] >= 0 and self._of[k] == i:
                self._of[k] = _NONE
                self._since[k] = t
                if self._used[k]:
                    self._finish(k)

    def pressed(self, is_modifier):
        """A key was pressed. A modifier ends only layers."""
        for k in range(_MOST):
            n = self._which[k]
            if n >= 0 and (not is_modifier or self._is_layer(n)):
                if self._of[k] >= 0:
                    self._used[k] = True
                else:
                    self._finish(k)

    def tick(self, t):
        """End what nobody has used in time."""
        for k in range(_MOST):
            if self._which[k] >= 0 and self._of[k] < 0:
                limit_t = self._engine.layout.behaviours[self._which[k] + 1]
                if limit_t and past(self._since[k], t) >= limit_t:
                    self._finish(k)

    def forget(self):
        """End what waits for the next key."""
        for k in range(_MOST):
            if self._which[k] >= 0 and self._of[k] < 0:
                self._finish(k)

    def holds(self, layer):
        """Return whether a layer is on for the next key only."""
        for k in range(_MOST):
            if self._which[k] >= 0 and self._of[k] < 0:
                n = self._which[k]
                if self._is_layer(n) and self._engine.layout.behaviours[n + 2] & 0xFFF == layer:
                    return True
        return False

    def _is_layer(self, n):
        return self._engine.layout.behaviours[n + 2] >> 20 == MOMENTARY

    def _finish(self, k):
        n = self._which[k]
        self._which[k] = _NONE
        self._change(n, -1)

    def _change(self, n, change):
        engine = self._engine
        action = engine.layout.behaviours[n + 2]
        if self._is_layer(n):
            engine.layers.hold(action & 0xFFF, change)
        elif change > 0:
            engine.merger.press(engine.sink, action)
        else:
            engine.merger.release(engine.sink, action)
