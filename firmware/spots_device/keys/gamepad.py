"""Turns readings into gamepad axes: X is the position, Z the force, button 1 the touch.

Without a touch all values are 0, like a centred stick. Integers only; allocates nothing.
"""

from ..fingers.tracker import DOUBTFUL
from ..reading import decode

_BITS = 22  # most bits of a length: with 8 more bits it still fits a small integer
_X_MAX = 32_767


class GamepadAxes:
    """Turns readings into the axes and the button of a `usb.gamepad.GamepadReports`."""

    def __init__(self, sink):
        self._sink = sink
        self._length_um = self._shift = self._full_mN = 0

    def set_range(self, length_um, full_mN):
        """Centre the axes, release the button, and set the full scale of the axes.

        A press at `length_um` moves X to its right end, and a force of `full_mN` moves Z to its
        maximum.
        """
        self.release()
        self._length_um = max(1, length_um)
        self._full_mN = full_mN
        self._shift = 0
        while self._length_um >> self._shift >= 1 << _BITS:
            self._shift += 1

    def take(self, flags, position_um, force_mN):
        """Process a reading; during a touch, an untrusted reading changes nothing.

        Any bit of `tracker.DOUBTFUL` marks the reading as untrusted, unless these bits are exactly
        `decode.FITS_WITH_DRIFT`.
        """
        if not flags & decode.TOUCHING:
            self._sink.update(0, 0, 0, 0)
        elif not flags & DOUBTFUL or flags & DOUBTFUL == decode.FITS_WITH_DRIFT:
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
