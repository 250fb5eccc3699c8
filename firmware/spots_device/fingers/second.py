"""Estimates position and light of a second finger; checks whether the first finger rests.

A finger rests if neither its position nor its force changes.

Let l1 and l2 be the light of the two fingers, and d the distance between them. A reading measures
the light of both, l = l1 + l2. Its position lies between the fingers, at the distance f * d from
the first finger, with 0 < f < 1. Its brightness (here a natural logarithm) is slightly less than
ln(l):

    f / (1 - f) = l2 / l1 * exp(-k d)        ln(l) - brightness = 0.39 f (1 - f) (k d)**2

k is the decay at wavelengths that the dye absorbs. On strips of 30 to 85 mm, the errors of f
and of ln(l) are below 0.01. l1 is known from a reading of the first finger alone. A reading of both
gives two values, position and brightness, for the two unknowns l2 and d. So one reading cannot show
whether the first finger rests: several readings must give the same result. All integers fit 31
bits; allocates nothing.
"""

from .. import const
from ..reading.log2 import log2_q20
from . import state as c
from .locate import light, power

_ROOM_UM = const(300)  # least distance of a reading's position from each finger
_STEP_UM = const(2000)  # change of the distance, with which `weigh` measures the uncertainty


def _far_um(s):
    # Returns the distance from the first finger to the strip's end on the side of the reading.
    end_um = s[c.LENGTH_UM] + c.NEAR_UM if s[c.X_NOW_UM] > s[c.X_UM] else -c.NEAR_UM
    return end_um - s[c.X_UM]


def may_be_still(s):
    """Return whether the first finger may be as bright in the present reading as before.

    `s` is the state of a `tracker.ContactTracker`. The result is False if the first finger must
    have become dimmer, even with a second finger at the strip's end.
    """
    off_um = s[c.X_NOW_UM] - s[c.X_UM]
    far_um = _far_um(s)
    sign = 1 if far_um > 0 else -1
    far_um = min(far_um * sign, (1 << c.FAR_LOG2))
    if off_um * sign < _ROOM_UM:
        return True
    return (
        off_um * sign < far_um - _ROOM_UM
        and light(s, far_um * sign, True) >= power(s[c.B] - c.EVEN) >> 6
    )


def weigh(s):
    """Estimate both fingers from two readings that differ only in the second finger's force.

    The readings are the present one and the one before, in the state `s` of a
    `tracker.ContactTracker`. Returns whether there is a second finger. Stores three elements of the
    state, from `FOUND_UM` on: position of the second finger and its uncertainty in um, and
    brightness of the first finger.
    """
    a_um = s[c.X_LAST_UM] - s[c.X_UM]
    b_um = s[c.X_NOW_UM] - s[c.X_UM]
    far_um = _far_um(s)
    sign = 1 if far_um > 0 else -1
    low = max(a_um * sign, b_um * sign) + _ROOM_UM
    high = far_um * sign
    if min(a_um * sign, b_um * sign) < _ROOM_UM or not low < high < (1 << c.FAR_LOG2):
        return False
    low *= sign
    high *= sign
    above = light(s, low, False) < 0
    if above == (light(s, high, False) < 0):
        return False
    for _ in range(8):
        middle = low + high >> 1
        if above == (light(s, middle, False) < 0):
            low = middle
        else:
            high = middle
    first = light(s, low, True)
    if first < 16 or abs(low) < c.APART_UM:
        return False
    gap = light(s, low + sign * _STEP_UM, False)
    s[c.FOUND_UM] = s[c.X_UM] + low
    s[c.FOUND_SLACK_UM] = min(first * (_STEP_UM // 80) // (abs(gap) + 1), (1 << c.FAR_LOG2))
    s[c.FOUND_B] = log2_q20(first) - (4 << 20)
    return True
