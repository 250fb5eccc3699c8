"""Turns the fingers on a strip into switches: each finger presses one switch of the engine.

The tracker finds a finger after its first light. The engine gets the time of the first light, so
that the order of presses and releases is that of the fingers. Integers only; allocates nothing.
"""

from .. import const
from ..fingers.state import B_NOW, BEGAN, LEAVING, LEFT, RELEASE_T, SECOND, STATE, T_NOW, TWO
from ..fingers.tracker import ContactTracker
from .engine import Engine
from .switch import past

_NONE = const(-1)
_LATE_T = const(60)  # longest wait for a second finger that is not found yet
# Longest time, from its first light on, that a touch waits until its key is certain.
_CERTAIN_T = const(7)


class Keypad:
    """Converts readings to key events of `sink`, see `engine.Engine`.

    ``sink.stuck()`` is called when a touch has not moved for ``stuck_ms`` of the layout.
    """

    def __init__(self, sink, merger):
        self._sink = sink
        self.engine = Engine(sink, merger)
        self.contact = ContactTracker(self)
        self.take = self.contact.take
        self._s = self.contact.state
        self._clear()

    def set_layout(self, layout, length_um, decay, cross=None):
        """Release all keys, and use another layout; `decay` is that of `locate.locate`."""
        self.engine.set_layout(layout, length_um)
        self._clear()
        self.contact.set_layout(layout, length_um, decay, cross)

    def tick(self, t):
        """Process a reading's events, and what has a time limit at the time `t` in ticks.

        Must be called after every reading.
        """
        self.engine.tick(self.until(t))

    def until(self, t):
        """Return the time up to which all events are known, for `engine.Engine.tick`.

        It does not advance while a reading may still become an earlier event: the light has ended
        but the release is not certain yet, a second finger may touch that is not found yet, or the
        key of a finger is not certain yet.
        """
        s = self._s
        if s[LEAVING]:
            self._has_gap = True
            t = s[LEFT]
        elif s[STATE] == TWO and not s[SECOND] and past(s[BEGAN], t) < _LATE_T:
            t = s[BEGAN]
        return self._began_t if self._waits else t

    @property
    def layer(self):
        """Number of the layer that the next touch uses."""
        return self.engine.layers.top()

    def release(self):
        """Release all keys; a finger that still touches presses no key until it is lifted."""
        self.engine.release()
        self._clear()
        self.contact.spend()

    def forget(self):
        """Drop a pending double tap, and what is sticky for the next key."""
        self.engine.forget()

    # Events of tracker.ContactTracker.

    def down(self, x_um, t):
        self._third_um = _NONE
        self._has_gap = False
        self._waits = True
        self._began_t = self._since(t)
        self._wait(x_um, t)

    def at(self, x_um, t):
        self._third_um = _NONE  # a finger that is alone
        self._has_gap = False
        if self._waits:
            self._wait(x_um, t)
            return False
        return self.engine.move(self._first, x_um, t)

    def firm(self, t):
        self._press_waiting()
        self.engine.firm(self._first, t)

    def up(self, t):
        self._press_waiting()
        s = self._s
        if past(s[LEFT], t) <= s[RELEASE_T] + _LATE_T:
            t = s[LEFT]
        self._release_second(t)
        self._release_first(t)

    def next(self, x_um, t):
        # The first finger has left, and another one touches: usually before that, unless the light
        # had ended in between.
        self._press_waiting()
        first = self._first
        self._release_second(t)
        if self._has_gap and past(self._s[LEFT], self._since(t)):
            self.engine.release_one(first, self._s[LEFT])
            first = _NONE
        if self._third_um < 0 or not self.engine.same_key(x_um, self._third_um):
            self._press_first(x_um, self._since(t))
        else:
            self._first = _NONE
        self._third_um = _NONE
        self.engine.release_one(first, t)

    def second(self, x_um, slack_um, t):
        """Press the key under a second finger, if it is certain; return whether it was pressed.

        A key is certain if the whole range `x_um` +- `slack_um` is on it.
        """
        self._press_waiting()
        engine = self.engine
        if not engine.is_pressed(self._first) or not engine.is_certain(x_um, slack_um):
            return False
        if engine.same_key(x_um, self._x_um) or self._is_known(x_um):
            return False
        if self._second >= 0:  # a third finger
            self._release_second(t)
            self._third_um = x_um
            engine.release_one(engine.press(x_um, t), t)
            return True
        self._second = engine.press(x_um, self._since(t))
        self._second_um = x_um
        return self._second >= 0

    def moved(self, x_um, slack_um):
        pass

    def left(self, second, t):
        """Release the key of a finger that has lifted: of the second finger if `second` is true.

        After the first finger has lifted, the second finger becomes the first one.
        """
        self._press_waiting()
        if second:
            self._release_second(t)
            return
        self._release_first(t)
        self._first = self._second
        self._x_um = self._second_um
        self._second = _NONE

    def stuck(self):
        self._press_waiting()
        t = self._s[T_NOW]
        self._release_second(t)
        self._release_first(t)
        self._sink.stuck()

    def _wait(self, x_um, t):
        # While the force rises, the noise falls: the first readings may lie on a neighbouring key.
        self._x_um = x_um
        slack_um = self.contact.noise_um(self._s[B_NOW])
        if past(self._began_t, t) >= _CERTAIN_T or self.engine.is_certain(x_um, slack_um):
            self._press_waiting()

    def _press_waiting(self):
        if self._waits:
            self._waits = False
            self._first = self.engine.press(self._x_um, self._began_t)

    def _press_first(self, x_um, t):
        self._x_um = x_um
        self._has_gap = False
        self._first = self.engine.press(x_um, t)

    def _release_first(self, t):
        self.engine.release_one(self._first, t)
        self._first = _NONE

    def _release_second(self, t):
        self.engine.release_one(self._second, t)
        self._second = _NONE

    def _is_known(self, x_um):
        engine = self.engine
        if self._third_um >= 0 and engine.same_key(x_um, self._third_um):
            return True
        return self._second >= 0 and engine.same_key(x_um, self._second_um)

    def _since(self, t):
        # Time of the first light of a finger that was found now.
        began = self._s[BEGAN]
        return began if past(began, t) < _LATE_T else t

    def _clear(self):
        self._first = self._second = _NONE  # their switches
        self._waits = False  # whether the first finger waits until its key is certain
        self._began_t = 0  # ticks: its first light
        self._x_um = self._second_um = 0
        self._third_um = _NONE  # position of a third finger that was typed
        self._has_gap = False  # whether the light has ended since the first finger touched
