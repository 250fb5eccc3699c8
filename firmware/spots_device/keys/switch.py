"""State of the switches of `engine.Engine`, and the time of their events."""

from ..fingers.state import TICKS

SWITCHES = 6  # pressed at the same time, or waiting
MANY = 24  # the same for a layout with texts

# State of a switch: elements of `Engine.switches`, from the switch's number times `SIZE` on.
STATE = 0
ROW = 1  # key, as index in `KeyMap.keys`; -1 without a key
ACTION = 2  # pressed action, or 0
BEGAN = 3  # ticks
X_UM = 4  # position at the press
STEP_UM = 5  # position of the last step of a slide
LAYER = 6
SIZE = 7

# In this order: comparisons use it.
FREE = 0
SEEKS = 1  # between two keys
WAITS = 2  # its press is in the queue
OPEN = 3
SLIDING = 4
PRESSED = 5
OVER = 6  # causes no more actions


def past(since, now):
    """Return the ticks from `since` to `now`; 0 if `now` is earlier. Ticks wrap."""
    ticks = (now - since) & (TICKS - 1)
    return ticks if ticks < TICKS >> 1 else 0
