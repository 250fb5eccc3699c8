"""Keyboard engine: presses and releases of switches cause the actions of a layout.

A switch is pressed at a position. The key at this position has a decision to make if it has more
than a tap: until then it is *open*. At most one switch is open. Later events wait in a queue with
their own times, and are processed when the switch is decided:

=====================  ============================================================================
event                  decision of the open switch
=====================  ============================================================================
swipe                  the action of the layer's swipe; its key does nothing
firm press             the action of the firm press
slide                  a slide: each step has its own action
its release            tap, or the first tap of a double tap
another press          hold-preferred, tap-unless-interrupted: hold; without a hold: tap; the other
                       flavors: none
release of a press     balanced: hold; the other flavors: none
that waits
end of its time        hold; tap-unless-interrupted, or without a hold: tap. With a retro tap: if
                       no other key waits, the next press decides that it is a hold
=====================  ============================================================================

The time of an event counts, not when it arrives: if the time of the open switch is over at the time
of an event, the end of its time decides first. The release of a switch that was pressed before the
open one does not wait, unless this switch holds a modifier.

Events also wait while the outbox of USB reports is full, and during a text (see text.py). A tapped
key of the computer stays down for ``tap_ms`` of the layout, which delays no other key. Times are in
ticks (see fingers/state.py). Integers only; allocates nothing but in `set_layout` with another
layout.

The stack of an RP2040 has 8 KB, enough for 25 nested calls. So the methods that report an event
only store it, and a decision only stores its action. `tick`, which the loop of the board calls,
processes both one after the other.
"""

from array import array

from .. import const
from ..usb.usages import CAPS_LOCK_KEY, KEYBOARD, MODIFIERS_FROM, PLAIN
from . import layout as layouts
from . import switch
from .layers import Layers
from .switch import Switches, past

_QUEUE = const(16)  # events

# Kinds of events. An event in the queue has kind, switch, position and time.
_PRESS = const(0)
_RELEASE = const(1)
_IS_FIRM = const(2)
_EVENT = const(4)

_BRIEF = const(4)  # tapped keys that are down at the same time
_BACK_T = const(64)  # more than `Keypad.until` goes back
# Which tapped keys are released.
_OVER = const(0)  # those whose time is over
_MODIFIERS = const(1)
_ALL = const(2)

# What decides an open switch.
_OWN_UP = const(0)
_OTHER_DOWN = const(1)
_OTHER_UP = const(2)
_TIMER = const(3)

_NONE = const(-1)


class Engine:
    """Turns events of switches into actions of keys.

    `sink` receives the key events, see `merge.Merger`; ``sink.has_room()`` returns whether it can
    take the reports of an event.
    """

    def __init__(self, sink, merger):
        self.sink = sink
        self.merger = merger
        self.layout = None
        self._length_mm = 1
        self.switches = None
        self._make_switches(switch.SWITCHES, _QUEUE)
        self.layers = Layers()
        self._brief = array("i", bytes(8 * _BRIEF))  # tapped keys: action, or 0, and ticks
        self._briefs = 0  # how many
        self._t = _NONE
        self._set_behaviours({})
        self._clear()

    def set_layout(self, layout, length_um):
        """Release all switches, and use another layout on a strip of this length."""
        self.release()
        # A thousandth of the strip in um, because the bounds of keys are in thousandths.
        self._length_mm = max(1, length_um // 1000)
        if layout is not self.layout:
            self.layout = None  # until all is there: the memory may not suffice
            self._make_behaviours(layout)
            self.layout = layout

    def _make_behaviours(self, layout):
        # Class of each kind; its module has the same name. Its method ``press(i, n, t)`` presses
        # the behaviour at the index `n` of the layout with the switch `i`.
        table = {
            layouts.STICKY: "Sticky",
            layouts.TAP_DANCE: "Dance",
            layouts.MOD_MORPH: "Morph",
            layouts.KEY_REPEAT: "Repeat",
            layouts.CAPS_WORD: "Caps",
            layouts.TEXT: "Text",
        }
        self._set_behaviours({})
        made = {}
        # A board has no memory for behaviours that its layout does not use.
        for kind in layout.kinds:
            name = table.get(kind)
            if name:
                module = __import__("spots_device.keys." + name.lower(), None, None, (name,))
                made[kind] = getattr(module, name)(self)
        self._set_behaviours(made)
        if layout.moves:
            from .moves import Moves

            self._moves = Moves(self)
        if self._text is None:
            self._make_switches(switch.SWITCHES, _QUEUE)
        else:
            # A text takes seconds: room for touches meanwhile, each a press and a release.
            self._make_switches(switch.MANY, 3 * switch.MANY)

    def _set_behaviours(self, made):
        self._moves = None
        self._made = made
        self._sticky = made.get(layouts.STICKY)
        self._dance = made.get(layouts.TAP_DANCE)
        self._morph = made.get(layouts.MOD_MORPH)
        self._repeat = made.get(layouts.KEY_REPEAT)
        self.caps = made.get(layouts.CAPS_WORD)
        self._text = made.get(layouts.TEXT)

    def _make_switches(self, most, places):
        if self.switches is None or most != self.switches.most:
            self._queue = array("i", bytes(4 * places * _EVENT))
            self._places = places
            self.switches = Switches(most)  # last: without memory, the next call makes both

    # Events of switches.

    def press(self, x_um, t):
        """Press a switch at `x_um` at the time `t`; return its number, or -1 if none is free."""
        # The call frames of this module have at most 11 words, see reading/strip.py.
        i = self.switches.free()
        if i < 0:
            return _NONE
        self.switches.place(i, x_um)
        if self._is_on_key(x_um, t):
            # Room for the releases of all switches is kept free.
            if not self._has_place():
                return _NONE
            self.switches.state[i] = switch.WAITS
            self._put(_PRESS, i, x_um, t)
        else:
            self.switches.state[i] = switch.SEEKS
        return i

    def release_one(self, i, t):
        """Release the switch `i` at the time `t`."""
        if i >= 0 and self.switches.state[i]:
            self._put(_RELEASE, i, 0, t)

    def firm(self, i, t):
        """Report that the switch `i` is pressed firmly."""
        if i >= 0 and switch.WAITS <= self.switches.state[i] <= switch.OPEN and self._has_place():
            self._put(_IS_FIRM, i, 0, t)

    def move(self, i, x_um, t):
        """Report the position of the switch `i`; return True if no further ones are needed."""
        if i < 0:
            return True
        state = self.switches.state[i]
        if state >= switch.PRESSED:
            return True
        if state == switch.SEEKS:
            if self._row_at(self.layers.top(), x_um) >= 0 and self._has_place():
                self.switches.place(i, x_um)
                self.switches.state[i] = switch.WAITS
                self._put(_PRESS, i, x_um, t)
        elif state >= switch.OPEN and self._moves is not None:
            self._moved = i
            self._moved_um = x_um
            self._moved_t = t
        return False

    def tick(self, t):
        """Process all events; then decide what has a time limit.

        All events up to the time `t` have been reported.
        """
        if self._t >= 0 and past(t, self._t) > _BACK_T:
            self.forget()  # the clock of a board on the host: it has restarted
        self._t = t
        if self._briefs and self.sink.has_room():
            self._end_taps(_OVER)
        if self._text is not None:
            self._text.tick(t)
        self.run()
        if self._sticky is not None:
            self._sticky.tick(t)
        if self._tapped >= 0 and past(self._tapped_t, t) >= self.layout.quick_tap_t:
            self._age(t)
        while self._next_action < 0 and not self._types() and self._is_late(t):
            self.run()

    def run(self):
        """Process what has been reported and decided, as far as the reports have room."""
        while self.sink.has_room():
            if self._types():
                if not self._text.step():
                    return
            elif self._next_action >= 0:
                self._perform()
            elif self._moved >= 0:
                self._follow()
            elif self._seen < self._count:
                self._next((self._first + self._seen) % self._places * _EVENT)
            else:
                return

    def _types(self):
        return self._text is not None and self._text.busy

    def forget(self):
        """Drop pending double taps, and what is sticky for the next key; end texts and taps."""
        if self._text is not None:
            self._text.forget()
        self._end_taps(_ALL)
        self._due = self._tapped = _NONE
        if self._dance is not None:
            self._dance.forget()
        if self._sticky is not None:
            self._sticky.forget()

    def release(self):
        """Release all switches, drop all events, end caps word, and switch layers above 0 off."""
        for i in range(self.switches.most + 1):
            # In this order: an interrupt in between must not hide a pressed key.
            if self.switches.action[i]:
                self._end(i, 0)
                self.switches.action[i] = 0
            self.switches.state[i] = switch.FREE
        if self.caps is not None:
            self.caps.forget()
        self._clear()
        self.forget()

    def is_pressed(self, i):
        """Return whether the switch `i` is pressed or waits."""
        return i >= 0 and self.switches.state[i] > switch.FREE

    def is_certain(self, x_um, slack_um):
        """Return whether the range `x_um` +- `slack_um` is on one key, where no finger is."""
        if not self._is_on_one(self.layers.top(), x_um, slack_um):
            return False
        if self._open >= 0 and self._hold >> 20 == layouts.MOMENTARY:
            return self._is_on_one(self._hold & 0xFFF, x_um, slack_um)
        return True

    def same_key(self, x_um, other_um):
        """Return whether two positions are on the same key, or both beside all keys."""
        layer = self.layers.top()
        return self._row_at(layer, x_um) == self._row_at(layer, other_um)

    def _is_on_key(self, x_um, t):
        if self._row_at(self.layers.top(), x_um) >= 0 or self._again_at(x_um, t) >= 0:
            return True
        return (
            self._open >= 0
            and self._hold >> 20 == layouts.MOMENTARY
            and self._row_at(self._hold & 0xFFF, x_um) >= 0
        )

    def _has_place(self):
        return self._count + self.switches.most < self._places

    # The queue.

    def _put(self, kind, i, x_um, t):
        at = (self._first + self._count) % self._places * _EVENT
        q = self._queue
        q[at] = kind
        q[at + 1] = i
        q[at + 2] = x_um
        q[at + 3] = t
        self._count += 1

    def _remove(self):
        # Removes the event after those that wait.
        q = self._queue
        k = self._seen
        while k:
            at = (self._first + k) % self._places * _EVENT
            before = (self._first + k - 1) % self._places * _EVENT
            q[at] = q[before]
            q[at + 1] = q[before + 1]
            q[at + 2] = q[before + 2]
            q[at + 3] = q[before + 3]
            k -= 1
        self._first = (self._first + 1) % self._places
        self._count -= 1

    def _next(self, at):
        # Processes the event at the index `at` of the queue.
        t = self._queue[at + 3]
        if self._open < 0:
            if self._do(at):
                self._remove()
        elif self.wait_t and past(self._began_t(), t) >= self.wait_t:
            self._decide(_TIMER, t)
        elif self._queue[at + 1] != self._open:
            self._beside(at, t)
        elif self._queue[at] == _RELEASE:
            self._decide(_OWN_UP, t)
        else:
            self._remove()
            self._press_firmly(t)

    def _beside(self, at, t):
        # An event of another switch while a switch is open.
        kind = self._queue[at]
        i = self._queue[at + 1]
        waits = self.switches.state[i] == switch.WAITS
        if kind == _RELEASE and not waits and not _is_modifier(self.switches.action[i]):
            self._do(at)
            self._remove()
            return
        self._seen += 1
        if kind == _PRESS:
            self._decide(_OTHER_DOWN, t)
        elif kind == _RELEASE and waits:
            self._decide(_OTHER_UP, t)

    def _do(self, at):
        # Returns whether the event is processed; otherwise an action comes before it.
        i = self._queue[at + 1]
        t = self._queue[at + 3]
        if self._queue[at] == _PRESS:
            return self._begin(i, self._queue[at + 2], t)
        if self._queue[at] == _RELEASE:
            if self._due_of == i:
                self._due_of = _NONE
                self._due_t = t
            self._let_go(i, t)
        return True

    def _let_go(self, i, t):
        if self.switches.action[i]:
            self._end(i, t)
            self.switches.action[i] = 0
        if self._dance is not None:
            self._dance.released(i, t)
        self.switches.state[i] = switch.FREE

    # Decisions.

    def _begin(self, i, x_um, t):
        """Process a press: an action at once if nothing else is possible, else an open switch.

        Returns False if another action comes first.
        """
        row = self._again_at(x_um, t)
        if row < 0:
            row = self._row_at(self.layers.top(), x_um)
            if self._sticky is not None:
                self._was_sticky = self._sticky.holds(self.layers.top())
        if self._due >= 0:
            if row == self._due:
                self._due = _NONE
                self.switches.row[i] = row
                self._act(i, self.layout.keys[row + layouts.DOUBLE], t)
                return True
            self._tap_due(t)  # it may switch the layer
            return False
        if self._dance is not None and self._dance.beside(row, t):
            return False
        self._open_at(i, row, t)
        return True

    def _open_at(self, i, row, t):
        self.switches.row[i] = row
        self.switches.began[i] = t
        self.switches.layer[i] = self.layers.top()
        self.switches.state[i] = switch.SEEKS
        if row >= 0:
            self._prepare(row)
            is_open = self.wait_t or self._slides(row)
            if not is_open or (self._hold and self._is_quick(row, t)):
                self._tap(i, row, t)
                return
            self.switches.state[i] = switch.OPEN
            self._open = i
        self._tapped = _NONE

    def _tap(self, i, row, t):
        self._tapped = row
        self._tapped_t = t
        self._act(i, self.layout.keys[row + layouts.TAP], t)

    def _prepare(self, row):
        # Sets how the switch at `row` is decided.
        layout = self.layout
        keys = layout.keys
        self._hold = hold = keys[row + layouts.HOLD]
        self._flavor = layout.flavor
        self._quick_t = layout.quick_tap_t
        self._idle_t = layout.require_prior_idle_t
        self.wait_t = layout.tapping_term_t
        if hold >> 20 == layouts.BEHAVIOUR:
            n = layout.behaviour(hold & 0xFFF)
            b = layout.behaviours
            if b[n] == layouts.HOLD_TAP:
                self._flavor = b[n + 1]
                self.wait_t = b[n + 2]
                self._quick_t = b[n + 3]
                self._idle_t = b[n + 4]
                self._hold = b[n + 5]
        if not hold and not keys[row + layouts.DOUBLE]:
            self.wait_t = self._short_wait_t(row)

    def _short_wait_t(self, row):
        layout = self.layout
        swipes = self.swipes(self.layers.top())
        if self._slides(row):
            return layout.swipe_t if swipes else 0  # after it, no swipe is possible
        wait_t = layout.firm_t if layout.keys[row + layouts.FIRM] else 0
        return max(wait_t, layout.swipe_t) if swipes else wait_t

    def _is_quick(self, row, t):
        if self._idle_t and self._key_t >= 0 and past(self._key_t, t) < self._idle_t:
            return True
        return row == self._tapped and past(self._tapped_t, t) < self._quick_t

    def _began_t(self):
        return self.switches.began[self._open]

    def _decide(self, event, t):
        """Decide the open switch if `event` does."""
        row = self.switches.row[self._open]
        if self._hold and event != _OWN_UP:
            if self._is_hold(event):
                if event == _TIMER and self._flavor & layouts.RETRO_TAP and not self._seen:
                    # From now on only another press decides: the release alone is a tap.
                    self.wait_t = 0
                    self._flavor = layouts.HOLD_PREFERRED
                else:
                    self._act(self.close(), self._hold, t)
                return
            if event != _TIMER:
                return
        elif event == _TIMER and self._slides(row) and not self.layout.keys[row + layouts.DOUBLE]:
            self.wait_t = 0  # it slides at any time
            return
        if event == _OWN_UP and self.layout.keys[row + layouts.DOUBLE]:
            self._due = row
            self._due_of = self.close()
            self._due_t = t
        else:
            t = self._began_t()
            self._tap(self.close(), row, t)

    def _is_hold(self, event):
        flavor = self._flavor & ~layouts.RETRO_TAP
        if event == _TIMER:
            return flavor != layouts.TAP_UNLESS_INTERRUPTED
        if event == _OTHER_UP:
            return flavor == layouts.BALANCED
        return flavor != layouts.BALANCED and flavor != layouts.TAP_PREFERRED

    def close(self):
        """Decide the open switch; return its number. The caller then presses its action."""
        i = self._open
        self._open = _NONE
        self._seen = 0
        self.switches.state[i] = switch.OVER
        return i

    def _press_firmly(self, t):
        action = self.layout.keys[self.switches.row[self._open] + layouts.FIRM]
        if action:
            self._act(self.close(), action, t)

    def _tap_due(self, t):
        row = self._due
        self._due = self._due_of = _NONE
        self.click(row, self.layout.keys[row + layouts.TAP], t)

    def _is_late(self, t):
        # Decides one thing whose time is over at the time `t`; returns whether there was one.
        if self._due >= 0 and past(self._due_t, t) >= self.layout.double_t:
            self._tap_due(t)
        elif self._dance is not None and self._dance.tick(t):
            pass
        elif (
            self._open >= 0
            and self.wait_t
            and past(self._began_t(), t) >= self.wait_t
            and self.sink.has_room()
        ):
            self._decide(_TIMER, t)
        else:
            return False
        return True

    def _follow(self):
        # Processes the last movement of a switch, one step at a time.
        i = self._moved
        if not (
            switch.OPEN <= self.switches.state[i] <= switch.SLIDING
            and self._moves.move(i, self._moved_um, self._moved_t)
        ):
            self._moved = _NONE

    # Actions.

    def _act(self, i, action, t):
        """Press an action next; the switch `i` then holds it."""
        self.switches.state[i] = switch.PRESSED
        self.then(i, action, t)

    def then(self, i, action, t):
        """Press an action next; release it at once if the switch `i` is not pressed.

        The switch after the last one is no finger's.
        """
        self._next_of = i
        self._next_action = action
        self._next_t = t

    def click(self, row, action, t):
        """Press and release an action of the key `row` next, for no switch."""
        self.switches.row[self.switches.most] = row
        self.then(self.switches.most, action, t)

    def _perform(self):
        # Presses the stored action.
        i = self._next_of
        t = self._next_t
        action = self._next_action
        self._next_action = self._next_of = _NONE
        self._start(i, action, t)
        if self._next_action < 0:
            self.hidden = 0
        if self._next_of != i and self.switches.state[i] != switch.PRESSED:
            self._end(i, t)
            self.switches.action[i] = 0
            if self._dance is not None:
                self._dance.released(i, t)

    def _start(self, i, action, t):
        self.switches.action[i] = action
        if action >> 20 == layouts.BEHAVIOUR:
            n = self.layout.behaviour(action & 0xFFF)
            self._made[self.layout.behaviours[n]].press(i, n, t)
        elif action >> 20 >= KEYBOARD:
            self.typed(self._press_key(i, action), t)
        elif action:
            if action >> 20 == layouts.TO and self._sticky is not None:
                self._sticky.forget()
            self.layers.press(action >> 20, action & 0xFFF)

    def _press_key(self, i, action):
        # Returns the action that is pressed, or 0.
        if self.caps is not None:
            action = self.caps.shifted(action, self.merger.held())
        self._end_taps(_MODIFIERS)  # a tapped modifier is not for another key
        if not self.merger.press(self.sink, action, self.hidden):
            self._end_taps(_ALL)  # for a place
            if not self.merger.press(self.sink, action, self.hidden):
                action = 0
        self.switches.action[i] = action
        self.switches.began[i] = self._t
        return action

    def typed(self, action, t):
        """Follow the press of a key or a text."""
        is_modifier = _is_modifier(action)
        if not is_modifier:
            self._key_t = t
            if self._repeat is not None:
                self._repeat.pressed(action)
        if self._sticky is not None:
            self._sticky.pressed(is_modifier)

    def _end(self, i, t):
        # Releases the action of the switch `i`; the caller then clears it.
        action = self.switches.action[i]
        kind = action >> 20
        if kind == layouts.MOMENTARY:
            self.layers.hold(action & 0xFFF, -1)
        elif kind == layouts.BEHAVIOUR:
            if self._sticky is not None:
                self._sticky.release(i, t)
        elif kind >= KEYBOARD:
            self.release_later(action, self.switches.began[i])
        if self._morph is not None:
            self._morph.released(i)

    def least_t(self, action):
        """Return the ticks for which a key of the computer is down at least."""
        layout = self.layout
        if action & PLAIN == CAPS_LOCK_KEY:
            return max(layout.tap_t, layout.caps_lock_t)
        return layout.tap_t

    def release_later(self, action, since):
        """Release an action that was pressed at `since`, or soon if that was just now."""
        # Later than now: the clock has restarted.
        if past(since, self._t) >= self.least_t(action) or past(self._t, since) > _BACK_T:
            self.merger.release(self.sink, action)
            return
        if self._briefs == _BRIEF:
            self._end_taps(_ALL)
        at = 2 * self._briefs
        self._brief[at] = action
        self._brief[at + 1] = since
        self._briefs += 1

    def _end_taps(self, which):
        b = self._brief
        k = 2 * self._briefs
        while k:
            k -= 2
            action = b[k]
            if (
                which == _ALL
                or (which and _is_modifier(action))
                or (not which and past(b[k + 1], self._t) >= self.least_t(action))
            ):
                self.merger.release(self.sink, action)
                self._briefs -= 1
                b[k] = b[2 * self._briefs]
                b[k + 1] = b[2 * self._briefs + 1]

    # Keys and their positions.

    def _row_at(self, layer, x_um):
        """Return the row (index in `layout.keys`) of the key of a layer at a position, or -1."""
        layout = self.layout
        keys = layout.keys
        row = layout.first(layer)
        last = layout.first(layer + 1)
        while row < last:
            # The ends of the strip belong to the outermost keys.
            if (
                keys[row + layouts.LOW] == 0 or x_um >= keys[row + layouts.LOW] * self._length_mm
            ) and (
                keys[row + layouts.HIGH] == layouts.FULL
                or x_um < keys[row + layouts.HIGH] * self._length_mm
            ):
                return row
            row += layouts.KEY_SIZE
        return _NONE

    def _again_at(self, x_um, t):
        """Return the row of the key that was tapped just before if a touch counts for it, or -1.

        Quick second touches are less accurate. So a touch outside the tapped key still counts for
        it if it is at most ``slack_um`` or a sixteenth of the key's width outside, whichever is
        less. If it lies on a neighbouring key, the tapped key must also have a ``hold`` or
        ``double`` action. A tapped key counts even if its sticky layer has ended.
        """
        row = self._due
        if row >= 0:
            if past(self._due_t, t) >= self.layout.double_t:
                return _NONE
        else:
            row = self._tapped
            if row < 0 or past(self._tapped_t, t) >= max(self.layout.quick_tap_t, self._quick_t):
                return _NONE
            if not (self._was_sticky or self.layout.is_on(self.layers.top(), row)):
                return _NONE
        if self._is_near(row, x_um) and (
            self.layout.keys[row + layouts.HOLD]
            or self.layout.keys[row + layouts.DOUBLE]
            or self._row_at(self.layers.top(), x_um) < 0
        ):
            return row
        return _NONE

    def _is_near(self, row, x_um):
        low_um = self.layout.keys[row + layouts.LOW] * self._length_mm
        high_um = self.layout.keys[row + layouts.HIGH] * self._length_mm
        slack_um = min(self.layout.slack_um, high_um - low_um >> 4)
        return low_um - slack_um <= x_um < high_um + slack_um

    def _age(self, t):
        if past(self._tapped_t, t) >= max(self.layout.quick_tap_t, self._quick_t):
            self._tapped = _NONE

    def _is_on_one(self, layer, x_um, slack_um):
        keys = self.layout.keys
        row = self._row_at(layer, x_um)
        if row < 0:
            return False
        return (
            keys[row + layouts.LOW] == 0
            or x_um - slack_um >= keys[row + layouts.LOW] * self._length_mm
        ) and (
            keys[row + layouts.HIGH] == layouts.FULL
            or x_um + slack_um <= keys[row + layouts.HIGH] * self._length_mm
        )

    def swipes(self, layer):
        """Return whether a layer has swipes."""
        return self.layout.swipe(layer, True) or self.layout.swipe(layer, False)

    def _slides(self, row):
        return (
            self.layout.keys[row + layouts.SLIDE_MINUS]
            or self.layout.keys[row + layouts.SLIDE_PLUS]
        )

    def _clear(self):
        self._first = self._count = self._seen = 0
        self._next_of = self._next_action = self._moved = _NONE
        self._next_t = self._moved_um = self._moved_t = 0
        self._open = self._tapped = self._due = self._due_of = _NONE
        self._hold = self._flavor = self.wait_t = self._quick_t = self._idle_t = 0
        self._tapped_t = self._due_t = 0
        self._key_t = _NONE
        self._was_sticky = False
        self.hidden = 0
        self.layers.clear()


def _is_modifier(action):
    return action >> 20 == KEYBOARD and action & 0xFFF >= MODIFIERS_FROM
