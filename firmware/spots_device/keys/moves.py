"""Swipes and slides: movements of a finger on a switch. Imported only if the layout has some.

A swipe decides first: on a layer with swipes, a slide begins when no swipe is possible any more.
"""

from . import layout as y
from . import switch as w
from .switch import past


class Moves:
    """Swipes and slides of an `engine.Engine`."""

    def __init__(self, engine):
        self._engine = engine

    def move(self, i, x_um, t):
        """Process a position of the switch `i`, which is open or slides."""
        at = i * w.SIZE
        off_um = x_um - self._engine.switches[at + w.X_UM]
        if not self._may_swipe(at, t):
            self._slide(i, x_um, t)
        elif abs(off_um) >= self._engine.layout.swipe_um:
            self._engine.close()
            self._swipe(i, off_um > 0, t)

    def _may_swipe(self, at, t):
        s = self._engine.switches
        return (
            s[at] == w.OPEN
            and self._engine.wait_t
            and self._engine.swipes(s[at + w.LAYER])
            and past(s[at + w.BEGAN], t) < self._engine.layout.swipe_t
        )

    def _swipe(self, i, plus, t):
        layer = self._engine.switches[i * w.SIZE + w.LAYER]
        action = self._engine.layout.swipe(layer, plus)
        self._engine.click(i, action, t)

    def _slide(self, i, x_um, t):
        engine = self._engine
        while engine.sink.has_room():
            off_um = x_um - engine.switches[i * w.SIZE + w.STEP_UM]
            if abs(off_um) < engine.layout.slide_um or not self._step(i, off_um > 0, t):
                return

    def _step(self, i, plus, t):
        engine = self._engine
        action = engine.row_of(i) + (y.SLIDE_PLUS if plus else y.SLIDE_MINUS)
        action = engine.layout.keys[action]
        if engine.switches[i * w.SIZE] == w.OPEN:
            if not action:
                return False
            engine.close()
        engine.switches[i * w.SIZE] = w.SLIDING
        engine.switches[i * w.SIZE + w.STEP_UM] += engine.layout.slide_um * (1 if plus else -1)
        engine.click(i, action, t)
        return True
