"""Reports of a mouse: buttons, and wheels that scroll in 120ths of a notch.

Imported only if the layout has an action of a mouse. A host that sets the resolution multiplier
(HID usage tables 1.5, section 4.3.1) gets 120ths of a notch; another one gets whole notches.
Integers only; allocates nothing after construction.
"""

from array import array

from .. import const
from .descriptors import MOUSE_SIZE
from .reports import Outbox
from .usages import NOTCH, WHEEL

_WHEELS = const(3)  # offset of the two wheels in a report; each has 16 bits
_MOST = const(32_767)

# The multipliers as the host has set them, bits 0 and 1 for the vertical wheel, 2 and 3 for the
# other one. A board has one mouse.
_multipliers = bytearray(1)


def set_multipliers(bits):
    """Set the resolution multipliers, the feature report of the mouse."""
    _multipliers[0] = bits


class MouseReports:
    """Turns buttons and wheels into reports; movements that wait in the queue are added up.

    Parameters and attributes are those of `reports.KeyboardReports`.
    """

    def __init__(self, send, ticks):
        self.outbox = Outbox(send, ticks, MOUSE_SIZE)
        self.unsent = False
        self._buttons = 0
        self._remainder = array("i", (0, 0))  # 120ths of a notch that are not in a report yet
        self._report = bytearray(MOUSE_SIZE)

    def key(self, number, modifiers, pressed):
        """Process the press or release of a button, or a notch of a wheel; see `usages.MOUSE`."""
        if number >= WHEEL:
            if pressed:
                self.scroll(number, NOTCH)
            return
        if self.unsent:
            self.flush()
        bit = 1 << number - 1
        self._buttons = self._buttons | bit if pressed else self._buttons & ~bit
        self.unsent = True

    def scroll(self, number, parts):
        """Scroll by 120ths of a notch in the direction `number`, see `usages.WHEEL`."""
        axis = number - WHEEL >> 1
        up_or_right = number == WHEEL or number == WHEEL + 3
        self._remainder[axis] += parts if up_or_right else -parts
        self.unsent = True

    def flush(self):
        """Put the changes into the queue. If the queue is full, they stay `unsent`."""
        if not self.unsent:
            return
        waiting = self.outbox.newest()
        if (waiting is None or waiting[0] != self._buttons) and self._has_changed():
            self._report[0] = self._buttons
            if not self.outbox.put(self._report):
                return
            waiting = self.outbox.newest()
        if waiting is not None:
            self._move(waiting, 0)
            self._move(waiting, 1)
        self.unsent = False

    def release(self):
        """Release all buttons; forget what has not been scrolled."""
        self._buttons = self._report[0] = self._remainder[0] = self._remainder[1] = 0
        self.unsent = False
        self.outbox.release()

    def _has_changed(self):
        if self._report[0] != self._buttons or abs(self._remainder[0]) >= _size(0):
            return True
        return abs(self._remainder[1]) >= _size(1)

    def _move(self, report, axis):
        # Adds as much of the rest to a report as fits.
        at = _WHEELS + 2 * axis
        size = _size(axis)
        remainder = self._remainder[axis]
        steps = remainder // size if remainder >= 0 else -(-remainder // size)
        before = report[at] | report[at + 1] << 8
        if before > _MOST:
            before -= 0x10000
        steps = min(max(steps, -_MOST - before), _MOST - before)
        self._remainder[axis] -= steps * size
        report[at] = before + steps & 0xFF
        report[at + 1] = before + steps >> 8 & 0xFF


def _size(axis):
    # 120ths of a notch that the host scrolls for each step of a report.
    return 1 if _multipliers[0] >> 2 * axis & 3 else NOTCH
