"""Runs the firmware's keypad in CPython, with a reading every 10 ms, and records its events."""

from __future__ import annotations

import math

from spots_device.fingers.state import TICKS
from spots_device.keys.keypad import Keypad
from spots_device.keys.layout import (
    KEYBOARD,
    LIMITS,
    action,
    parse,
)
from spots_device.keys.merge import Merger
from spots_device.reading.decode import TOO_DARK, TOUCHING

LENGTH_UM = 100_000
DECAY = 289  # nearly that of the default strip
READING_MS = 10


def letter(usage, modifiers=0):
    """Return the action (int) that presses the keyboard key `usage`."""
    return action(KEYBOARD, usage, modifiers)


def key(low, high, tap=0, double=0, hold=0, firm=0, minus=0, plus=0):
    """Return the line ``key`` of a layout, see `spots_device.keys.layout`."""
    return f"key {low} {high} {tap} {double} {hold} {firm} {minus} {plus}"


class Desk:
    """A keypad with a layout, and a simulated finger.

    Attributes
    ----------
    events : list of (int, bool)
        Usage of each key event, and whether the key was pressed; ``modifiers`` has the modifiers of
        each press. ``usages`` has the same of single usages.
    """

    def __init__(self, *lines, length_um=LENGTH_UM, decay=DECAY, number=int):
        self._number = number
        self._events = []
        self.modifiers = []
        self.usages = []
        self.objects = 0
        self.now_ms = (TICKS * 1024 // 1000) - 300  # the ticks wrap after 300 ms
        self.pad = Keypad(self, Merger())
        self.pad.set_layout(parse(["tap_ms 0", *lines]), number(length_um), number(decay))
        self.lift(60)

    @property
    def events(self):
        self.pad.engine.run()  # as the board's loop does
        return self._events

    def usage(self, page, usage, modifiers, pressed):
        self.usages.append((int(usage), pressed))

    def key(self, page, usage, modifiers, pressed):
        self._events.append((int(usage), pressed))
        if pressed:
            self.modifiers.append(int(modifiers))

    def has_room(self):
        return True

    def stuck(self):
        self.objects += 1

    def read(self, flags, x_um=0, force_mN=0):
        """Give the keypad a reading with position in um and force in mN; advance the time."""
        t = self._number(self.now_ms * 1000 // 1024 % TICKS)
        number = self._number
        # 0.4 counts for each millinewton, as on the default strip.
        brightness = round(math.log2(max(0.4 * int(force_mN), 1)) * (1 << 20))
        self.pad.take(number(flags), number(x_um), number(force_mN), number(brightness), t)
        self.pad.tick(t)
        self.now_ms += READING_MS

    def press(self, x_mm, milliseconds=60, force_mN=1000, flags=TOUCHING):
        """Press at a position for a time; the finger then still touches."""
        for _ in range(milliseconds // READING_MS):
            self.read(flags, int(1000 * x_mm), force_mN)

    def slide(self, from_mm, to_mm, milliseconds):
        """Slide a finger that already touches; the finger then still touches."""
        steps = milliseconds // READING_MS
        for i in range(steps):
            self.press(from_mm + (to_mm - from_mm) * (i + 1) / steps, READING_MS)

    def lift(self, milliseconds=60):
        """Lift the finger, and wait for a time."""
        for _ in range(milliseconds // READING_MS):
            self.read(TOO_DARK)

    def tap(self, x_mm, milliseconds=60, gap_ms=60, **options):
        """Press for `milliseconds`, lift, and wait for `gap_ms`."""
        self.press(x_mm, milliseconds, **options)
        self.lift(gap_ms)


def clicks(*usages):
    """Return the events (usage, pressed) of keys that are typed one after the other."""
    return [event for usage in usages for event in ((usage, True), (usage, False))]


def rolled(first, second):
    """Return the events of two keys of which the second is pressed before the first is released."""
    return [(first, True), (second, True), (first, False), (second, False)]


def limit(name):
    """Return the default value of a statement in `layout.LIMITS`."""
    return LIMITS[name][2]
