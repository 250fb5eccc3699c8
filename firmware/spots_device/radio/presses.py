"""Three firm presses of two seconds: how who wears the strip lets a host bond, without USB."""

from .. import const

_FIRM_MN = const(2_000)
_LIGHT_MN = const(500)  # below this, the press has ended
_HELD_US = const(2_000_000)
_PAUSE_US = const(3_000_000)  # at most, between two presses
_PRESSES = const(3)


class Presses:
    """Counts firm presses. `are_made` allocates nothing."""

    def __init__(self, clock):
        self._clock = clock
        self._count = 0
        self._is_firm = self._is_counted = False
        self._since = clock.ticks_us()  # of the press, or of the pause

    def forget(self):
        """Begin again."""
        self._count = 0
        self._is_firm = False

    def are_made(self, force_mN):
        """Take the present force; return True once the third press has lasted two seconds."""
        now = self._clock.ticks_us()
        past_us = self._clock.ticks_diff(now, self._since)
        if not self._is_firm:
            if force_mN >= _FIRM_MN:
                self._is_firm, self._is_counted, self._since = True, False, now
            elif self._count and past_us > _PAUSE_US:
                self._count = 0
        elif force_mN < _LIGHT_MN:
            if not self._is_counted:
                self._count = 0
            self._is_firm, self._since = False, now
        elif not self._is_counted and past_us > _HELD_US:
            self._is_counted = True
            self._count += 1
            if self._count == _PRESSES:
                self._count = 0
                return True
        return False
