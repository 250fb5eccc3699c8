"""Time of key events, in the ticks of fingers/state.py."""

from ..fingers.state import TICKS


def past(since, now):
    """Return the ticks from `since` to `now`; 0 if `now` is earlier. Ticks wrap."""
    ticks = (now - since) & (TICKS - 1)
    return ticks if ticks < TICKS >> 1 else 0
