"""Processes a reading of a finger that rests or moves slowly: the most frequent kind of reading.

Integers only; allocates nothing.
"""

from ..reading import decode
from . import state as c


def stays(s, flags):
    """Process a reading of a finger that rests or moves slowly; return whether this was done.

    If not, the state is unchanged, and `tracker.ContactTracker.take` processes the reading.
    """
    x_um = s[c.X_NOW_UM]
    force_mN = s[c.FORCE_NOW_MN]
    t = s[c.T_NOW]
    off_um = x_um - s[c.X_UM]
    if not (
        flags & (decode.TOUCHING | decode.LED_OFF | decode.NOT_CALIBRATED | decode.SATURATED)
        == decode.TOUCHING
        and bool(flags & decode.MISFIT) == bool(flags & decode.TOO_DARK)
        and not s[c.LEAVING]
        and -c.SAME_UM < off_um < c.SAME_UM
        and s[c.RELEASE_MN] <= force_mN < s[c.FIRM_MN]
        and (
            not s[c.STUCK_T]
            or (
                s[c.LOW_UM] <= x_um <= s[c.HIGH_UM]
                and s[c.LOW_MN] <= force_mN <= s[c.HIGH_MN]
                and (t - s[c.STILL]) & (c.TICKS - 1) < s[c.STUCK_T]
            )
        )
    ):
        return False
    s[c.FORCE_MN] = force_mN
    s[c.X_BEFORE_UM] = s[c.X_UM]
    s[c.X_UM] += off_um >> 1
    s[c.X_SEEN_UM] = x_um
    s[c.B_OLDEST] = s[c.B_BEFORE]
    s[c.B_BEFORE] = s[c.B]
    s[c.B] = s[c.B_NOW]
    s[c.LOOSE] = False
    s[c.DRIFTS] = flags & decode.MISFIT
    s[c.T] = t
    return True
