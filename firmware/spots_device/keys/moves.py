"""Swipes and slides: movements of a finger on a switch. Imported only if the layout has some.

A slide repeats its action each time the finger has moved by ``slide_um``. A wheel of a mouse turns
smoothly instead, by a notch for this distance.

A swipe decides first: on a layer with swipes, a slide begins when no swipe is possible any more.
"""

from ..usb.usages import MOUSE, NOTCH, WHEEL
from . import layout as layouts
from . import switch
from .switch import past


class Moves:
    """Swipes and slides of an `engine.Engine`."""

    def __init__(self, engine):
        self._engine = engine

    def move(self, i, x_um, t):
        """Process a position of the switch `i`, which is open or slides.

        Returns whether the position may cause another step of a slide.
        """
        if not self._may_swipe(i, t):
            return self._step(i, x_um, t)
        off_um = x_um - self._engine.switches.x_um[i]
        if abs(off_um) >= self._engine.layout.swipe_um:
            self._engine.close()
            self._swipe(i, off_um > 0, t)
        return False

    def _may_swipe(self, i, t):
        s = self._engine.switches
        return (
            s.state[i] == switch.OPEN
            and self._engine.wait_t
            and self._engine.swipes(s.layer[i])
            and past(s.began[i], t) < self._engine.layout.swipe_t
        )

    def _swipe(self, i, plus, t):
        engine = self._engine
        action = engine.layout.swipe(engine.switches.layer[i], plus)
        engine.then(i, action, t)

    def _step(self, i, x_um, t):
        off_um = x_um - self._engine.switches.x_um[i]
        if self._engine.switches.state[i] == switch.SLIDING and self._turn(i, off_um):
            return False
        slide_um = self._engine.layout.slide_um
        if abs(off_um) < slide_um:
            return False
        return self._slide(i, slide_um if off_um > 0 else -slide_um, t)

    def _slide(self, i, um, t):
        s = self._engine.switches
        action = self._action(i, um > 0)
        if s.state[i] == switch.OPEN:
            if not action:
                return False
            self._engine.close()
            s.state[i] = switch.SLIDING
        if not _is_wheel(action):
            s.x_um[i] += um
            self._engine.then(i, action, t)
        return True

    def _turn(self, i, off_um):
        # Turns a wheel; returns whether the slide is one of a wheel.
        action = self._action(i, off_um > 0)
        if not _is_wheel(action):
            return False
        slide_um = self._engine.layout.slide_um
        parts = abs(off_um) * NOTCH // slide_um
        um = (parts * slide_um + (NOTCH >> 1)) // NOTCH
        self._engine.switches.x_um[i] += um if off_um > 0 else -um
        if parts:
            self._engine.sink.scroll(action & 0xFFF, parts)
        return True

    def _action(self, i, plus):
        engine = self._engine
        return engine.layout.keys[
            engine.switches.row[i] + (layouts.SLIDE_PLUS if plus else layouts.SLIDE_MINUS)
        ]


def _is_wheel(action):
    return action >> 20 == MOUSE and action & 0xFFF >= WHEEL
