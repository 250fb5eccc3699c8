"""Mod-morph: another action while a modifier is down. Imported only if the layout uses it."""

from .. import const

_NONE = const(-1)


class Morph:
    """Mod-morphs of an `engine.Engine`."""

    def __init__(self, engine):
        self._engine = engine
        self._of = _NONE  # switch whose action hides modifiers

    def press(self, i, n, t):
        """Press the behaviour at the index `n` with the switch `i`."""
        b = self._engine.layout.behaviours
        if self._engine.merger.down & b[n + 1]:
            self._of = i
            self._hide(b[n + 1] & ~b[n + 2])
            self._engine.then(i, b[n + 4], t)
        else:
            self._engine.then(i, b[n + 3], t)

    def _hide(self, bits):
        self._engine.merger.mask(self._engine.sink, bits)

    def released(self, i):
        """The switch `i` was released."""
        if self._of == i:
            self._of = _NONE
            self._hide(0)
