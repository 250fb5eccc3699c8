"""Readings to touches: press, movement, force and release, debounced.

A press counts after `detect` valid readings in a row, a release after a time (release debounce); an
untrusted reading neither begins nor ends a touch. A finger whose place jumps is the next finger:
with two on the strip the reading belongs to neither. Integers only; allocates nothing.
"""

from .decode import LED_OFF, MISFIT, NOT_CALIBRATED, SATURATED, TOO_DARK, TOUCHING

DOUBTFUL = LED_OFF | MISFIT | NOT_CALIBRATED | SATURATED | TOO_DARK
# Time is in ticks of 1.024 ms: the board's microseconds without their lower ten bits, so that it
# wraps where they do.
TICK_US = 1024
TICKS = 1 << 22

_UP = 0
_DOWN = 1
_SPENT = 2  # what lies there must be lifted before it makes another touch


def elapsed(since, now):
    """Return the ticks from one time to a later one."""
    return (now - since) & (TICKS - 1)


class Contact:
    """Turns readings into touches.

    Parameters
    ----------
    sink : object
        ``down(x_um, t)``, ``at(x_um, t)`` for every further reading that can be trusted,
        ``firm(t)`` once when it gets that hard, ``up(t)``, ``next(x_um, t)`` for another finger
        in the place of this one, ``stuck()`` for one that does not move for long.

    Attributes
    ----------
    force_mN : int
        Of the last reading that could be trusted.
    """

    def __init__(self, sink):
        self._sink = sink
        self._layout = None
        self._state = _SPENT
        self._seen = 0  # readings in a row that may begin a touch
        self._x_um = self._x_seen_um = 0
        self._leaving = False
        self._left = self._down = self._still = 0
        self._firm = False
        self._rest_um = self._rest_mN = 0
        self.force_mN = 0

    @property
    def touched(self):
        """Whether a finger is down."""
        return self._state == _DOWN

    def set_layout(self, layout):
        """Use these limits; what lies on the strip must be lifted before it makes a touch."""
        self._layout = layout
        self.spend()

    def spend(self):
        """Forget the touch; the finger has to be lifted before it makes another."""
        self._state = _SPENT
        self._seen = 0
        self._leaving = False

    def take(self, flags, position_um, force_mN, t):
        """Take a reading, at time `t` in ticks."""
        if flags & LED_OFF:
            return  # the LED was off: neither a touch nor the end of one
        layout = self._layout
        if not flags & TOUCHING or (force_mN < layout.release_mN and not flags & DOUBTFUL):
            self._seen = 0
            self._lift(t)
            return
        self._leaving = False
        if flags & DOUBTFUL:
            self._seen = 0
            return
        self.force_mN = force_mN
        if self._state == _UP:
            self._press(position_um, force_mN, t)
        else:
            self._follow(position_um, force_mN, t)

    def _lift(self, t):
        if self._state == _UP:
            return
        if not self._leaving:
            self._leaving = True
            self._left = t
        if elapsed(self._left, t) < self._layout.release_t:
            return
        self._leaving = False
        down, self._state = self._state == _DOWN, _UP
        if down:
            self._sink.up(t)

    def _press(self, x_um, force_mN, t):
        layout = self._layout
        if force_mN < layout.press_mN:
            self._seen = 0
            return
        if self._seen and abs(x_um - self._x_seen_um) > layout.jump_um:
            self._seen = 0  # of two fingers, or a spark
        self._x_seen_um = x_um
        self._seen += 1
        if self._seen >= layout.detect:
            self._begin(x_um, force_mN, t)
            self._sink.down(x_um, t)
            self._harden(force_mN, t)

    def _begin(self, x_um, force_mN, t):
        self._state = _DOWN
        self._seen = 0
        self._x_um = x_um
        self._firm = False
        self._rest_um = x_um
        self._rest_mN = force_mN
        self._still = t

    def _follow(self, x_um, force_mN, t):
        layout = self._layout
        if layout.stuck_t and self._rests(x_um, force_mN, t):
            self._state = _SPENT
            self._sink.stuck()
            return
        if self._state == _SPENT:
            return
        if abs(x_um - self._x_um) > layout.jump_um:
            if self._seen and abs(x_um - self._x_seen_um) > layout.jump_um:
                self._seen = 0
            self._x_seen_um = x_um
            self._seen += 1
            if self._seen >= layout.detect:
                self._begin(x_um, force_mN, t)
                self._sink.next(x_um, t)
                self._harden(force_mN, t)
            return
        self._seen = 0
        self._x_um = x_um
        self._sink.at(x_um, t)
        self._harden(force_mN, t)

    def _harden(self, force_mN, t):
        if not self._firm and force_mN >= self._layout.firm_mN and self._state == _DOWN:
            self._firm = True
            self._sink.firm(t)

    def _rests(self, x_um, force_mN, t):
        layout = self._layout
        if (
            abs(x_um - self._rest_um) > layout.slide_um >> 1
            or abs(force_mN - self._rest_mN) > self._rest_mN >> 2
        ):
            self._rest_um = x_um
            self._rest_mN = force_mN
            self._still = t
            return False
        if elapsed(self._still, t) < layout.stuck_t:
            return False
        self._still = t
        return True
