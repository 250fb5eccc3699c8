"""Reports of a gamepad. Imported only if the board is one."""

from .descriptors import REPORT_SIZE
from .reports import Outbox

_BUTTONS = 6  # offset of the buttons in a report


class GamepadReports:
    """Turns axes and buttons of a gamepad into reports.

    Each change of a button gets its own report. Changes of axes that still wait in the queue are
    merged into one report.
    """

    unsent = False  # `update` sends each change itself

    def __init__(self, send, ticks):
        self.outbox = Outbox(send, ticks)
        self._report = bytearray(REPORT_SIZE)
        self._last = bytearray(REPORT_SIZE)

    def update(self, x, y, z, buttons):
        """Set the axes x and y (-32767 to 32767) and z (0 to 32767), and 16 bits of buttons."""
        self._put(0, x)
        self._put(2, y)
        self._put(4, z)
        self._put(_BUTTONS, buttons)
        self._send()

    def _send(self):
        report, last = self._report, self._last
        if _same(report, last, 0):
            return
        newest = self.outbox.newest()
        if newest is not None and _same(report, newest, _BUTTONS):
            _copy(report, newest)
        elif not self.outbox.put(report):
            return  # the next reading tries again
        _copy(report, last)

    def _put(self, at, value):  # the call of `pack_into` would need the heap
        self._report[at] = value & 0xFF
        self._report[at + 1] = value >> 8 & 0xFF

    def release(self):
        """Release all buttons and centre all axes."""
        for i in range(REPORT_SIZE):
            self._last[i] = 0
        self.outbox.release()


def _same(one, other, start):
    bits = 0
    for i in range(start, REPORT_SIZE):
        bits |= one[i] ^ other[i]
    return bits == 0


def _copy(source, target):
    for i in range(REPORT_SIZE):
        target[i] = source[i]
