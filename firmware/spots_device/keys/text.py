"""Texts and macros: keys that are pressed one after the other. Imported only if the layout uses it.

A key is down for ``text_ms`` of the layout. When its modifiers change, they are down for this time
before it; between two equal keys, the key is up for it. Events of switches wait until the end of a
text. Modifiers that are down before it are released for its time. A step has 16 bits, see `layout`.
"""

from .. import const
from ..usb.usages import CAPS_LOCK_KEY, CONSUMER, KEYBOARD, KEYS_MAX, MODIFIERS_FROM, PLAIN
from .layout import MEDIA_FROM, NEXT_BITS, PRESS, RELEASE
from .switch import past

_AT_ONCE = const(5)  # most steps between two readings; with USB HID, the outbox has room for five


class Text:
    """The text that an `engine.Engine` types, one at a time; `busy` until its end."""

    def __init__(self, engine):
        self._engine = engine
        self.busy = False
        self._next = self._end = 0  # indices in the steps of the layout
        self._down = self._bits = self._drops = 0
        self._kept = bytearray(KEYS_MAX)  # usages that are down until the end
        self._modifiers = self._kept_bits = 0  # that are down; those until the end
        self._t = self._since = self._wait_t = self._left = 0

    def press(self, i, n, t):
        """Begin with the text of the behaviour at the index `n`."""
        engine = self._engine
        b = engine.layout.behaviours
        self._next = b[n + 1]
        self._end = self._next + b[n + 2]
        self._bits = self._wait_t = self._modifiers = 0
        self._drops = engine.merger.drops
        self.busy = True
        engine.merger.replace(engine.sink, 0)
        engine.typed(engine.switches.action[i], t)

    def tick(self, t):
        """Allow steps at the time `t` in ticks."""
        self._t = t
        self._left = _AT_ONCE
        if self._engine.merger.drops != self._drops:  # the computer reads no reports
            self.forget()

    def step(self):
        """Process the next step; return False if it must wait for the next `tick`."""
        if not self._left or past(self._since, self._t) < self._wait_t:
            return False
        self._since = self._t
        self._wait_t = 0
        self._left -= 1
        if self._next == self._end:
            self.forget()
        elif self._type(self._engine.layout.steps[self._next]):
            self._next += 1
            if self._next == self._end and self._down and not self._kept_bits:
                self.forget()  # without a wait: a finger's next key follows
        return True

    def forget(self):
        """End the text; the key that it has pressed last is released in its time."""
        engine = self._engine
        if self._kept_bits:
            self._up()
        elif self._down:
            engine.release_later(self._down, self._since)
            self._down = 0
        for k in range(KEYS_MAX):
            if self._kept[k]:
                engine.merger.release(engine.sink, KEYBOARD << 20 | self._kept[k])
                self._kept[k] = 0
        self._kept_bits = 0
        if self.busy:
            engine.merger.replace(engine.sink, -1)
            self.busy = False

    def _type(self, step):
        # Returns whether the step is complete.
        usage = step & 0xFF
        bits = step >> 8
        if usage == NEXT_BITS:
            self._bits = bits
            return True
        if not usage:
            self._up()
            self._wait_t = bits * 1250 >> 7  # in units of 10 ms
            return True
        if PRESS <= usage <= RELEASE:  # a tuple of imported names would be allocated
            return self._keep(bits, usage == PRESS)
        if usage >= MEDIA_FROM:
            action = CONSUMER << 20 | self._bits << 12 | (usage - MEDIA_FROM) << 8 | bits
        else:
            action = KEYBOARD << 20 | bits << 12 | usage
        return self._click(action)

    def _click(self, action):
        engine = self._engine
        if engine.caps is not None:
            action = engine.caps.shifted(action, self._kept_bits)
        bits = action >> 12 & 0xFF | self._kept_bits
        if self._down and (bits != self._modifiers or not (self._down ^ action) & PLAIN):
            self._up()
            self._modify(bits)
            return False
        if bits != self._modifiers:
            self._modify(bits)
            return False
        self._up()
        self._down = action  # first: an interrupt in between must not hide a pressed key
        if not engine.merger.press(engine.sink, action):
            self._down = 0
            return False
        self._bits = 0
        self._wait_t = engine.layout.text_t
        if action & PLAIN == CAPS_LOCK_KEY:
            self._wait_t = max(self._wait_t, engine.least_t(action))
        return True

    def _up(self):
        engine = self._engine
        if self._down:
            engine.merger.release(engine.sink, self._down)
            self._down = 0

    def _modify(self, bits):
        self._modifiers = bits
        self._engine.merger.replace(self._engine.sink, bits)
        self._wait_t = self._engine.layout.text_t

    def _keep(self, usage, down):
        # Presses or releases a key that stays down.
        self._up()
        engine = self._engine
        self._wait_t = engine.layout.text_t
        if usage >= MODIFIERS_FROM:
            bit = 1 << usage - MODIFIERS_FROM
            self._kept_bits = self._kept_bits | bit if down else self._kept_bits & ~bit
            self._modify(self._kept_bits)
            return True
        k = self._find(0 if down else usage)
        if k < 0:
            return True
        if self._modifiers != self._kept_bits:
            self._modify(self._kept_bits)
            return False
        if down and not engine.merger.press(engine.sink, KEYBOARD << 20 | usage):
            return False
        if not down:
            engine.merger.release(engine.sink, KEYBOARD << 20 | usage)
        self._kept[k] = usage if down else 0
        return True

    def _find(self, usage):
        k = KEYS_MAX - 1
        while k >= 0 and self._kept[k] != usage:
            k -= 1
        return k
