"""Readings to a gamepad: X is the position, Z the force, button 1 the touch.

Without a touch all is 0, like a centred stick. Integers only; allocates nothing.
"""

from .contact import DOUBTFUL
from .decode import TOUCHING

_BITS = 22  # of a length, so that 8 more fit a small integer
_X_MAX = 32_767


class GamepadAxes:
    """Turns readings into the state of a gamepad.

    Parameters
    ----------
    sink : object
        As `hid.GamepadReports`.
    """

    def __init__(self, sink):
        self._sink = sink
        self._length_um = self._shift = self._full_mN = 0

    def set_range(self, length_um, full_mN):
        """Release all, and set the length and force at the ends of X and Z."""
        self.release()
        self._length_um = max(1, length_um)
        self._full_mN = full_mN
        self._shift = 0
        while self._length_um >> self._shift >= 1 << _BITS:
            self._shift += 1

    def take(self, flags, position_um, force_mN):
        """Take a reading; an untrusted one changes nothing while the touch lasts."""
        if not flags & TOUCHING:
            self._sink.update(0, 0, 0, 0)
        elif not flags & DOUBTFUL:
            self._sink.update(self._x(position_um), 0, self._z(force_mN), 1)

    def release(self):
        """Centre the axes and release the button."""
        self._sink.release()

    def _x(self, position_um):
        # 16 bits in two steps of 8: a product would not fit a small integer.
        length = self._length_um >> self._shift
        part = min(max(position_um, 0), self._length_um) >> self._shift << 8
        high = part // length
        low = (part - high * length << 8) // length
        return min(max((high << 8 | low) - _X_MAX - 1, -_X_MAX), _X_MAX)

    def _z(self, force_mN):
        return min(force_mN, self._full_mN) * 4095 // self._full_mN << 3
