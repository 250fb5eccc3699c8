"""Touches to key events: equal zones along the strip, one key for one touch.

A finger that slides into another zone goes on holding the first key. Integers only, allocates
nothing.
"""

from .decode import LED_OFF, MISFIT, NOT_CALIBRATED, SATURATED, TOO_DARK, TOUCHING

# HID usages of the keys 1 to 9 and 0, from the sensor's end on.
USAGES = (30, 31, 32, 33, 34, 35, 36, 37, 38, 39)
DOUBTFUL = LED_OFF | MISFIT | NOT_CALIBRATED | SATURATED | TOO_DARK


class Keypad:
    """Turns readings into key events.

    Parameters
    ----------
    sink : object
        ``key(usage, modifiers, pressed)``.
    """

    def __init__(self, sink):
        self._key = sink.key
        self._zone_um = 0
        self._held = 0  # the usage that is pressed
        self._over = False  # this touch presses nothing any more

    def set_length(self, length_um):
        """Let go, and spread the keys over a strip of this length."""
        self.release()
        self._zone_um = max(1, (length_um + len(USAGES) - 1) // len(USAGES))

    def take(self, flags, position_um, force_mN):
        """Take a reading; a doubtful one presses nothing, and holds what is pressed."""
        if flags & LED_OFF:
            return  # blind: neither a touch nor the end of one
        if not flags & TOUCHING:
            self._let_go()
            self._over = False
        elif not (self._held or self._over or flags & DOUBTFUL):
            zone = min(max(position_um // self._zone_um, 0), len(USAGES) - 1)
            self._held = USAGES[zone]
            self._key(self._held, 0, True)

    def release(self):
        """Let go; a finger that is still there presses nothing until it was lifted."""
        self._let_go()
        self._over = True

    def _let_go(self):
        if self._held:
            usage, self._held = self._held, 0
            self._key(usage, 0, False)
