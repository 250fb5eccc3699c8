"""Converts touches to key events: tap, double tap, hold, firm press, slide, swipe, layers.

A gesture is decided as soon as it is unambiguous; a key with one action is pressed immediately. The
end of a touch releases the pressed action, even if the layer has changed since the press. Integers
only; allocates nothing. Times are in the ticks of tracker.py (1.024 ms).
"""

from .. import const
from ..fingers.tracker import ContactTracker, elapsed
from .layout import (
    DOUBLE,
    FIRM,
    HIGH,
    HOLD,
    HOLD_PREFERRED,
    KEY_SIZE,
    KEYBOARD,
    LOW,
    MOMENTARY,
    ONCE,
    SLIDE_MINUS,
    SLIDE_PLUS,
    TAP,
    TOGGLE,
)

_IDLE = const(0)
_OPEN = const(1)  # a finger touches, and its action is not decided yet
_PRESSED = const(2)  # an action is pressed until the finger leaves
_SLIDING = const(3)
_OVER = const(4)  # the finger still touches but causes no more actions

_NONE = const(-1)


class Keypad:
    """Converts readings to key events.

    Parameters
    ----------
    sink : object
        Receiver of the events, see `merge.Merger`. ``stuck()`` is called when a touch has not moved
        for ``stuck_ms`` of the layout.
    merger : merge.Merger
        State of the keyboard.
    """

    def __init__(self, sink, merger):
        self._sink = sink
        self._merger = merger
        self.contact = ContactTracker(self)
        self.take = self.contact.take
        self._layout = None
        self._length_mm = 0
        self._second = self._second_row = 0  # action and key of a second finger
        self._third = _NONE  # key that a third finger has tapped
        self._state = _IDLE
        self._clear()

    def set_layout(self, layout, length_um, decay):
        """Release all keys, and use another layout.

        Parameters
        ----------
        layout : layout.Layout
            Keys and limits.
        length_um : int
            Length of the strip, in um.
        decay : int
            Decay of the light by the dye, see `locate.locate`.
        """
        self.release()
        self._layout = layout
        # A thousandth of the strip in um, because the bounds of keys are in thousandths.
        self._length_mm = max(1, length_um // 1000)
        self.contact.set_layout(layout, length_um, decay)

    def tick(self, t):
        """Decide the gestures whose time limit is over at the time `t` in ticks.

        Must be called after every reading.
        """
        # Old times are dropped, because ticks wrap.
        if self._tapped_at >= 0:
            self._age_tap(t)
        if self._state == _OPEN and self._wait_t and elapsed(self._began, t) >= self._wait_t:
            self._wait_t = 0
            if self._action(HOLD):
                self._press(self._action(HOLD))
            elif self._action(DOUBLE) or not self._slides():
                self._press(self._action(TAP))

    def release(self):
        """Release all keys; a finger that still touches presses no key until it is lifted."""
        self._release_second()
        self._release_held()
        self._state = _IDLE
        self._clear()
        self.contact.spend()

    def forget(self):
        """Drop a pending double tap, and a layer that is on for the next key only."""
        self._due = self._tapped_at = self._once = _NONE

    # Events of tracker.ContactTracker.

    def down(self, x_um, t, typed=_NONE):
        self._third = _NONE
        again = self._tapped_at
        self._tapped_at = _NONE
        if again >= 0 and elapsed(self._tapped, t) >= self._layout.quick_t:
            again = _NONE
        self._row = row = self._find(x_um, again)
        self._began = t
        self._x_um = self._x_step_um = x_um
        due = self._due
        if due >= 0 and (row != due or elapsed(self._tapped, t) >= self._layout.double_t):
            self._tap_due()
            due = _NONE
            # This tap may have switched the layer.
            self._row = row = self._find(x_um, again)
        self._state = _OPEN
        if row < 0:
            self._wait_t = 0
            return
        if row == typed:
            self._state = _OVER
            return
        if due >= 0:
            self._due = _NONE
            self._press(self._action(DOUBLE))
            return
        self._wait_t = self._wait()
        if self._is_plain() or (row == again and self._action(HOLD)):
            self._press(self._action(TAP))

    def at(self, x_um, t):
        self._third = _NONE  # a finger that is alone
        if self._state == _PRESSED and self._row >= 0:
            return True
        self._move(x_um, t)
        return False

    def _move(self, x_um, t):
        layout = self._layout
        if self._row < 0:
            if self._state == _OPEN:
                self.down(x_um, t)  # the touch began between two keys and may reach a key
            return
        if self._state == _OPEN and self._wait_t and self._swipes():
            moved_um = x_um - self._x_um
            if abs(moved_um) >= layout.swipe_um and elapsed(self._began, t) < layout.swipe_t:
                self._state = _OVER
                self._click(layout.swipe(self._row_layer, moved_um > 0))
                return
        if self._state == _OVER or self._state == _IDLE:
            return
        while abs(x_um - self._x_step_um) >= layout.slide_um:
            plus = x_um > self._x_step_um
            action = self._action(SLIDE_PLUS if plus else SLIDE_MINUS)
            if not action and self._state == _OPEN:
                return
            self._state = _SLIDING
            self._x_step_um += layout.slide_um if plus else -layout.slide_um
            self._click(action)

    def firm(self, t):
        if self._state == _OPEN and self._row >= 0 and self._action(FIRM):
            self._press(self._action(FIRM))

    def up(self, t):
        self._release_second()
        if self._state == _OPEN and self._row >= 0:
            self._tapped, self._tapped_at = t, self._row
            if self._action(DOUBLE):
                self._due = self._row
                self._due_action = self._action(TAP)
            else:
                self._click(self._action(TAP))
        elif self._state == _PRESSED:
            self._release_held()
            self._tapped, self._tapped_at = t, self._row
        self._state = _IDLE

    def next(self, x_um, t):
        # One finger has just lifted; the next finger was already touching before that.
        prefers_hold = self._layout.flavour == HOLD_PREFERRED and self._state == _OPEN
        if prefers_hold and self._row >= 0 and self._action(HOLD):
            self._press(self._action(HOLD))
        elif self._state != _PRESSED or self._held >> 20 != MOMENTARY:
            self.up(t)
            self.down(x_um, t, self._third)
            return
        held = self._held
        self._state = _IDLE
        self.down(x_um, t)
        if self._state == _OPEN and self._row >= 0:
            # The held layer ends here, so the action of the next key must be decided now.
            self._press(self._action(TAP))
        self._give_back(held)

    def second(self, x_um, slack_um, t):
        """Press the key under a second finger, if it is certain; return whether it was pressed.

        A key is certain if the whole range `x_um` +- `slack_um` is on it, if it has no action but
        that of a tap, and if its layer has no swipes.

        Parameters
        ----------
        x_um, slack_um : int
            Position of the second finger and its uncertainty, in um.
        t : int
            Time in ticks.
        """
        if self._once >= 0 or self._state == _IDLE or self._state == _SLIDING:
            return False
        first = self._row
        layer = self._row_layer
        row = self._find(x_um, _NONE)
        self._row_layer = layer
        keys = self._layout.keys
        if (
            row < 0
            or row == first
            or row == self._third
            or (self._second and row == self._second_row)
            or (keys[row + LOW] and x_um - slack_um < keys[row + LOW] * self._length_mm)
            or (keys[row + HIGH] < 1000 and x_um + slack_um > keys[row + HIGH] * self._length_mm)
        ):
            return False
        self._row = row
        plain = not self._wait() and self._is_plain()
        self._row = first
        action = keys[row + TAP]
        if not plain or action >> 20 < KEYBOARD:
            return False
        if self._state == _OPEN and first >= 0:
            # The action of the first key must be decided now.
            if not self._action(HOLD):
                self._press(self._action(TAP))
            elif self._layout.flavour == HOLD_PREFERRED:
                self._press(self._action(HOLD))
            else:
                return False
        third = self._second
        self._release_second()
        self._second = action
        self._second_row = row
        self._merger.press(self._sink, action)
        if third:
            self._third = row
            self._release_second()
        return True

    def moved(self, x_um, slack_um):
        pass

    def left(self, second, t):
        """Release the key of a finger that has lifted: of the second finger if `second` is true.

        After the first finger has lifted, the second finger becomes the first one.
        """
        if second:
            self._release_second()
            return
        self._release_held()
        self._state = _PRESSED
        self._held = self._second
        self._second = 0
        self._row = self._second_row

    def stuck(self):
        self._release_second()
        self._release_held()
        self._state = _IDLE
        self._sink.stuck()

    # Keys and their actions.

    def _find(self, x_um, again):
        """Return the row (index in `layout.keys`) of the key at the position `x_um` in um, or -1.

        `again` is the row of the key that was tapped just before, or -1. Quick second touches are
        less accurate. So a touch outside the tapped key still counts for the tapped key if it is at
        most ``slack_um`` or a sixteenth of the key's width outside, whichever is less. If it lies
        on a neighbouring key, the tapped key must also have a ``hold`` or ``double`` action.
        """
        layout = self._layout
        keys = layout.keys
        length_mm = self._length_mm
        self._row_layer = layer = self.layer
        row = layout.first(layer)
        last = layout.first(layer + 1) - KEY_SIZE
        # The ends of the strip belong to the outermost keys.
        while row <= last and not (
            (x_um >= keys[row + LOW] * length_mm or keys[row + LOW] == 0)
            and (x_um < keys[row + HIGH] * length_mm or keys[row + HIGH] == 1000)
        ):
            row += KEY_SIZE
        if (
            again >= 0
            and layout.is_on(layer, again)
            and (row > last or keys[again + HOLD] or keys[again + DOUBLE])
        ):
            low_um = keys[again + LOW] * length_mm
            high_um = keys[again + HIGH] * length_mm
            slack_um = min(layout.slack_um, high_um - low_um >> 4)
            if low_um - slack_um <= x_um < high_um + slack_um:
                return again
        if row > last:
            return _NONE
        self._once = _NONE
        return row

    def _action(self, slot):
        return self._layout.keys[self._row + slot]

    def _swipes(self):
        layer = self._row_layer
        return self._layout.swipe(layer, True) or self._layout.swipe(layer, False)

    def _slides(self):
        return self._action(SLIDE_MINUS) or self._action(SLIDE_PLUS)

    def _is_plain(self):
        return not (self._wait_t or self._action(DOUBLE) or self._slides())

    def _wait(self):
        """Return the touch duration in ticks that decides the action; 0 if no duration decides."""
        layout = self._layout
        if self._action(HOLD) or self._action(DOUBLE):
            return layout.tapping_t
        if self._slides():
            return layout.swipe_t if self._swipes() else 0  # after it, no swipe is possible
        wait_t = layout.firm_t if self._action(FIRM) else 0
        if self._swipes():
            wait_t = max(wait_t, layout.swipe_t)
        return wait_t

    # Execution of actions.

    def _press(self, action):
        self._state = _PRESSED
        self._held = action
        kind = action >> 20
        number = action & 0xFFF
        if kind == MOMENTARY:
            self._momentary = number
        elif kind == TOGGLE:
            self._base = 0 if self._base == number else number
        elif kind == ONCE:
            self._once = number
        elif kind >= KEYBOARD:
            self._merger.press(self._sink, action)

    def _release_held(self):
        if self._state == _PRESSED:
            # In this order: an interrupt in between must not hide a pressed key.
            self._give_back(self._held)
            self._state = _IDLE
            self._held = 0

    def _release_second(self):
        if self._second:
            self._give_back(self._second)
            self._second = 0

    def _give_back(self, action):
        kind = action >> 20
        if kind == MOMENTARY:
            self._momentary = _NONE
        elif kind >= KEYBOARD:
            self._merger.release(self._sink, action)

    def _click(self, action):
        """Send press and release of an action's key; the state of the touch does not change."""
        state, held = self._state, self._held
        self._press(action)
        self._release_held()
        self._state, self._held = state, held

    def _age_tap(self, t):
        past_t = elapsed(self._tapped, t)
        if self._due >= 0 and past_t >= self._layout.double_t:
            self._tap_due()
        if self._due < 0 and past_t >= self._layout.quick_t:
            self._tapped_at = _NONE

    def _tap_due(self):
        self._due = _NONE
        self._click(self._due_action)

    # Layers.

    @property
    def layer(self):
        """Number of the layer that the next touch uses."""
        if self._once >= 0:
            return self._once
        return self._momentary if self._momentary >= 0 else self._base

    def _clear(self):
        self._base = self._row_layer = 0
        self._momentary = self._once = _NONE
        self._row = self._due = self._tapped_at = _NONE
        self._due_action = self._held = 0
        self._began = self._tapped = self._wait_t = 0
        self._x_um = self._x_step_um = 0
