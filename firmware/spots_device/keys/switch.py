"""The switches of `engine.Engine`, and the time of their events."""

from array import array

from ..fingers.state import TICKS

SWITCHES = 6  # pressed at the same time, or waiting
MANY = 24  # the same for a layout with texts

# States of a switch. In this order: comparisons use it.
FREE = 0
SEEKS = 1  # between two keys
WAITS = 2  # its press is in the queue
OPEN = 3
SLIDING = 4
PRESSED = 5
OVER = 6  # causes no more actions


class Switches:
    """One element of each array for each switch; that of `most` belongs to no finger."""

    def __init__(self, most):
        self.most = most
        numbers = bytes(4 * (most + 1))
        self.state = bytearray(most + 1)
        self.row = array("i", numbers)  # key, as index in `KeyMap.keys`; -1 without a key
        self.action = array("i", numbers)  # pressed action, or 0
        self.began = array("i", numbers)  # ticks
        self.x_um = array("i", numbers)  # position at the press, or of the last step of a slide
        self.layer = bytearray(most + 1)

    def free(self):
        """Return the number of a switch that is free, or -1."""
        i = 0
        while self.state[i]:
            i += 1
            if i == self.most:
                return -1
        return i

    def place(self, i, x_um):
        """Place a switch without a key or an action at a position."""
        self.row[i] = -1
        self.action[i] = 0
        self.x_um[i] = x_um


def past(since, now):
    """Return the ticks from `since` to `now`; 0 if `now` is earlier. Ticks wrap."""
    ticks = (now - since) & (TICKS - 1)
    return ticks if ticks < TICKS >> 1 else 0
