"""Touches to keys: tap, double tap, hold, firm press, slide, swipe, and layers.

A gesture is decided as early as it is unambiguous: at once where the key has one meaning. A release
belongs to what was pressed, whatever layer is on by then. Integers only; allocates nothing; time is
in the ticks of contact.py.
"""

from .contact import ContactTracker, elapsed
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

_IDLE = 0
_OPEN = 1  # a finger is down, and what it means is not decided
_PRESSED = 2  # an action is pressed until the finger leaves
_SLIDING = 3
_OVER = 4  # the finger is down and means nothing more

_NONE = -1


class Keypad:
    """Turns readings into key events.

    Parameters
    ----------
    sink : object
        ``key(page, usage, modifiers, pressed)``; ``stuck()``, called when something has lain
        on the strip for too long to be a finger.
    """

    def __init__(self, sink):
        self._key = sink.key
        self._stuck = sink.stuck
        self.contact = ContactTracker(self)
        self.take = self.contact.take
        self._layout = None
        self._length_mm = 0
        self._second = self._second_row = 0  # what a second finger holds
        self._state = _IDLE
        self._clear()

    def set_layout(self, layout, length_um):
        """Release all, and spread these keys over a strip of this length."""
        self.release()
        self._layout = layout
        # Shares are in thousandths: a thousandth of a strip this long is so many micrometres.
        self._length_mm = max(1, length_um // 1000)
        self.contact.set_layout(layout, length_um)

    def tick(self, t):
        """Run the deadlines up to time `t`; call it after every reading."""
        # A time is forgotten as soon as it means nothing more: it would wrap.
        if self._tapped_at >= 0:
            self._age_tap(t)
        if self._state == _OPEN and self._wait_t and elapsed(self._began, t) >= self._wait_t:
            self._wait_t = 0
            if self._action(HOLD):
                self._press(self._action(HOLD))
            elif self._action(DOUBLE) or not self._slides():
                self._press(self._action(TAP))

    def release(self):
        """Release all; a finger that is still there presses nothing until it was lifted."""
        self._release_second()
        self._release_held()
        self._state = _IDLE
        self._clear()
        self.contact.spend()

    def forget(self):
        """Forget the tap that waits for a second one, and the layer for one key."""
        self._due = self._tapped_at = self._once = _NONE

    # Events of contact.ContactTracker.

    def down(self, x_um, t):
        again = self._tapped_at
        self._tapped_at = _NONE
        quick = again >= 0 and elapsed(self._tapped, t) < self._layout.quick_t
        self._row = row = self._find(x_um, again if quick else _NONE)
        self._began = t
        self._x_um = self._x_step_um = x_um
        due = self._due
        if due >= 0 and (row != due or elapsed(self._tapped, t) >= self._layout.double_t):
            self._tap_due()
            due = _NONE
            # It may have switched the layer.
            self._row = row = self._find(x_um, again if quick else _NONE)
        self._state = _OPEN
        if row < 0:
            self._wait_t = 0
            return
        if due >= 0:
            self._due = _NONE
            self._press(self._action(DOUBLE))
            return
        self._wait_t = self._wait()
        if self._is_plain() or (quick and row == again and self._action(HOLD)):
            self._press(self._action(TAP))

    def at(self, x_um, t):
        layout = self._layout
        if self._row < 0:
            if self._state == _OPEN:
                self.down(x_um, t)  # it came down between two keys, and may still find one
            return
        if self._state == _OPEN and self._wait_t and self._swipes():
            moved_um = x_um - self._x_um
            if abs(moved_um) >= layout.swipe_um and elapsed(self._began, t) < layout.swipe_t:
                self._state = _OVER
                self._click(layout.swipe(self._row_layer, moved_um > 0))
                return
        if self._state != _OPEN and self._state != _SLIDING:
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
        # This finger has just left, but the next one was there before.
        prefers_hold = self._layout.flavour == HOLD_PREFERRED and self._state == _OPEN
        if prefers_hold and self._row >= 0 and self._action(HOLD):
            self._press(self._action(HOLD))
        elif self._state != _PRESSED or self._held >> 20 != MOMENTARY:
            self.up(t)
            self.down(x_um, t)
            return
        held = self._held
        self._state = _IDLE
        self.down(x_um, t)
        if self._state == _OPEN and self._row >= 0:
            # The hold ends here: what the next key is has to be known now.
            self._press(self._action(TAP))
        self._give_back(held)

    def second(self, x_um, slack_um, t):
        """Press the key of a second finger if that is certain; return whether it was pressed."""
        if self._once >= 0 or self._second or self._state == _IDLE or self._state == _SLIDING:
            return False
        first = self._row
        layer = self._row_layer
        row = self._find(x_um, _NONE)
        self._row_layer = layer
        keys = self._layout.keys
        if (
            row < 0
            or row == first
            or (keys[row + LOW] and x_um - slack_um < keys[row + LOW] * self._length_mm)
            or (keys[row + HIGH] < 1000 and x_um + slack_um > keys[row + HIGH] * self._length_mm)
        ):
            return False
        self._row = row
        plain = not self._wait() and self._is_plain()
        self._row = first
        action = keys[row + TAP]
        if not plain or action >> 20 < KEYBOARD or action == self._held:
            return False
        if self._state == _OPEN and first >= 0:
            # What the first key is has to be known now.
            if not self._action(HOLD):
                self._press(self._action(TAP))
            elif self._layout.flavour == HOLD_PREFERRED:
                self._press(self._action(HOLD))
            else:
                return False
            if action == self._held:
                return False
        self._second = action
        self._second_row = row
        self._key(action >> 20, action & 0xFFF, action >> 12 & 0xFF, True)
        return True

    def left(self, second, t):
        """Release the key of one of two fingers: of the second, or of the first."""
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
        self._stuck()

    # What a key means.

    def _find(self, x_um, again):
        """Return the row of the key at a place; near a border the key tapped before is kept."""
        layout = self._layout
        keys = layout.keys
        length_mm = self._length_mm
        self._row_layer = layer = self.layer
        if again >= 0 and layout.is_on(layer, again):
            slack_um = layout.slack_um
            if (
                keys[again + LOW] * length_mm - slack_um
                <= x_um
                < keys[again + HIGH] * length_mm + slack_um
            ):
                return again
        row = layout.first(layer)
        last = layout.first(layer + 1) - KEY_SIZE
        while row <= last:
            # The ends of the strip belong to the outermost keys.
            if (x_um >= keys[row + LOW] * length_mm or keys[row + LOW] == 0) and (
                x_um < keys[row + HIGH] * length_mm or keys[row + HIGH] == 1000
            ):
                self._once = _NONE
                return row
            row += KEY_SIZE
        return _NONE

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
        """Return how long the finger may go on before time decides; 0 for ever or not at all."""
        layout = self._layout
        if self._action(HOLD) or self._action(DOUBLE):
            return layout.tapping_t
        if self._slides():
            return layout.swipe_t if self._swipes() else 0  # then only the swipe is out of question
        wait_t = layout.firm_t if self._action(FIRM) else 0
        if self._swipes():
            wait_t = max(wait_t, layout.swipe_t)
        return wait_t

    # What an action does.

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
            self._key(kind, number, action >> 12 & 0xFF, True)

    def _release_held(self):
        if self._state == _PRESSED:
            # In this order: what interrupts it must not hide that a key is down.
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
            self._key(kind, action & 0xFFF, action >> 12 & 0xFF, False)

    def _click(self, action):
        """Press and release, whatever the finger goes on to do."""
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
        """The layer whose keys the next touch finds."""
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
