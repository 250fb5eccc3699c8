"""Merges the actions of all pressed keys into events of single usages, for board and host.

Each usage counts the keys that press it. A usage that is pressed again is released first, because
a computer would see no change otherwise. There are two kinds of modifiers:

- A modifier key, or a chord that ends with one (``LEFT_ALT+LEFT_SHIFT``), is down as long as its
  key is pressed.
- The modifiers before another key (``LEFT_SHIFT+1``) belong to this key. They end with it, or when
  another key is pressed: a roll from ``!`` to ``=`` must not type ``+``. The same is true for the
  modifier keys that are hidden from a key, such as that of a mod-morph.

Integers only; allocates nothing after construction.
"""

from array import array

from ..usb.usages import KEYBOARD, KEYS_MAX, MODIFIERS_FROM, PLAIN


class Merger:
    """State of one keyboard; all strips of a keyboard share it.

    The argument `sink` of the methods receives the events. ``sink.usage(page, usage, modifiers,
    pressed)`` handles the press or release of a single usage, such as that of a modifier. When the
    usages of an action are complete, ``sink.key(page, usage, modifiers, pressed)`` handles the
    action. In both, `modifiers` are the bits of all modifier keys that are down after the event.
    An `action` is that of `layout.action`; its kind is a HID usage page. `down` has the bits of all
    modifier keys that are down; the caller counts dropped reports in `drops`.
    """

    def __init__(self):
        self._usages = array("i", bytes(4 * KEYS_MAX))  # pressed actions without modifiers, or 0
        self._counts = bytearray(KEYS_MAX)  # keys that press each of them
        self._held = bytearray(8)  # pressed actions that hold each modifier
        # Modifiers that belong to the action `_owner`, and those that are hidden from it.
        self._own = self._hidden = self._owner = 0
        self._masked = self.drops = 0
        self._instead = -1
        self.down = 0

    def press(self, sink, action, hidden=0):
        """Press the usage of an action; return False if too many usages are pressed.

        The modifier keys of the bits `hidden` are released for it.
        """
        if self._holds(action):
            self._press_modifiers(sink, action)
            return True
        at = self._find(action & PLAIN)
        if at < 0:
            at = self._find(0)
            if at < 0:
                return False
        elif self._counts[at]:
            self._report(sink, action, False)
        self._usages[at] = action & PLAIN
        self._counts[at] += 1
        self._own = action >> 12 & 0xFF
        self._owner = action
        self._hidden = hidden
        self._set(sink, self.down & self._wanted())
        self._set(sink, self._wanted())
        self._report(sink, action, True)
        sink.key(action >> 20, action & 0xFFF, self.down, True)
        return True

    def _press_modifiers(self, sink, action):
        bits = self._holds(action)
        self._hold(bits, 1)
        self._owner = self._own = self._hidden = 0
        self._set(sink, self.down | bits)
        self._set(sink, self._wanted())
        sink.key(KEYBOARD, action & 0xFFF, self.down, True)

    def release(self, sink, action):
        """Release the usage of an action that `press` has pressed."""
        bits = self._holds(action)
        if bits:
            self._hold(bits, -1)
        else:
            at = self._find(action & PLAIN)
            if at < 0:
                self._set(sink, self._wanted())  # an interrupt may have been in between
                return
            # In this order: an interrupt in between must not hide a pressed key.
            if self._counts[at] == 1:
                self._report(sink, action, False)
                self._usages[at] = 0
            self._counts[at] -= 1
            if action == self._owner:
                self._own = self._hidden = self._owner = 0
        self._set(sink, self._wanted())
        sink.key(action >> 20, action & 0xFFF, self.down, False)

    def _holds(self, action):
        # Returns the modifiers of an action that presses only modifier keys, else 0.
        bit = (action & 0xFFF) - MODIFIERS_FROM
        if action >> 20 != KEYBOARD or not 0 <= bit < 8:
            return 0
        return action >> 12 & 0xFF | 1 << bit

    def _hold(self, bits, change):
        for i in range(8):
            if bits >> i & 1:
                self._held[i] = max(0, self._held[i] + change)

    def mask(self, sink, bits):
        """Release the modifier keys `bits` until `mask` is called again with other bits."""
        self._masked = bits
        self._set(sink, self._wanted())

    def replace(self, sink, bits):
        """Press these modifiers in place of all modifier keys; -1: the modifier keys again."""
        self._instead = bits
        self._set(sink, self._wanted())

    def held(self):
        """Return the bits of the modifier keys that are pressed, also of those that are hidden."""
        bits = 0
        for i in range(8):
            if self._held[i]:
                bits |= 1 << i
        return bits

    def _wanted(self):
        if self._instead >= 0:
            return self._instead | self._own
        return self.held() & ~(self._masked | self._hidden) | self._own

    def _set(self, sink, bits):
        # Releases modifiers from the last one on and presses them from the first one on, as a
        # person does.
        for i in range(7, -1, -1):
            if self.down & ~bits & 1 << i:
                self._switch(sink, i, False)
        for i in range(8):
            if bits & ~self.down & 1 << i:
                self._switch(sink, i, True)

    def _switch(self, sink, i, pressed):
        # In this order: an interrupt in between must not hide a pressed modifier.
        if pressed:
            self.down |= 1 << i
        sink.usage(KEYBOARD, MODIFIERS_FROM + i, self.down & ~(1 << i) | pressed << i, pressed)
        if not pressed:
            self.down &= ~(1 << i)

    def _report(self, sink, action, pressed):
        sink.usage(action >> 20, action & 0xFFF, self.down, pressed)

    def _find(self, usage):
        i = 0
        while i < KEYS_MAX:
            if self._usages[i] == usage:
                return i
            i += 1
        return -1
