"""Processes a reading of a finger that rests or moves slowly: the most frequent kind of reading.

Boards with ``viper = true`` in board.toml get steady_viper.py instead of this file: the same
function with identical results, in machine code. Integers only; allocates nothing.
"""

from ..reading.decode import (
    LED_OFF,
    MISFIT,
    NOT_CALIBRATED,
    SATURATED,
    TOO_DARK,
    TOUCHING,
)
from .state import (
    B_BEFORE,
    B_NOW,
    B_OLDEST,
    DRIFTS,
    FIRM_MN,
    FORCE_MN,
    FORCE_NOW_MN,
    HAS_DIPPED,
    HIGH_MN,
    HIGH_UM,
    LEAVING,
    LOOSE,
    LOW_MN,
    LOW_UM,
    RELEASE_MN,
    SAME_UM,
    STILL,
    STUCK_T,
    T_NOW,
    TICKS,
    X_BEFORE_UM,
    X_NOW_UM,
    X_SEEN_UM,
    X_UM,
    B,
    T,
)


def stays(s, flags):
    """Process a reading of a finger that rests or moves slowly; return whether this was done.

    If not, the state is unchanged, and `contact.ContactTracker.take` processes the reading.

    Parameters
    ----------
    s : array.array
        State `DOWN` of a `contact.ContactTracker` with the present reading, see contact_state.py.
    flags : int
        Flags of the reading.
    """
    x_um = s[X_NOW_UM]
    force_mN = s[FORCE_NOW_MN]
    t = s[T_NOW]
    off_um = x_um - s[X_UM]
    if not (
        flags & (TOUCHING | LED_OFF | NOT_CALIBRATED | SATURATED) == TOUCHING
        and bool(flags & MISFIT) == bool(flags & TOO_DARK)
        and not s[LEAVING]
        and -SAME_UM < off_um < SAME_UM
        and s[RELEASE_MN] <= force_mN < s[FIRM_MN]
        and (
            not s[STUCK_T]
            or (
                s[LOW_UM] <= x_um <= s[HIGH_UM]
                and s[LOW_MN] <= force_mN <= s[HIGH_MN]
                and (t - s[STILL]) & (TICKS - 1) < s[STUCK_T]
            )
        )
    ):
        return False
    s[FORCE_MN] = force_mN
    s[X_BEFORE_UM] = s[X_UM]
    s[X_UM] += off_um >> 1
    s[X_SEEN_UM] = x_um
    s[B_OLDEST] = s[B_BEFORE]
    s[B_BEFORE] = s[B]
    s[B] = s[B_NOW]
    s[LOOSE] = s[HAS_DIPPED] = False
    s[DRIFTS] = flags & MISFIT
    s[T] = t
    return True
