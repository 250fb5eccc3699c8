"""Evidence about a second and a third finger, from readings of `tracker.ContactTracker`.

The argument `s` of each function is the state of a tracker, see state.py.
The functions store their estimates in it; tracker.py decides which fingers touch, and reports them.
Integers only; allocates nothing.
"""

from .. import const
from . import state as c
from .locate import estimate, noise
from .second import may_be_still, weigh

_REMAINS_UM = const(2000)  # largest distance to the second finger at the end of a lift
_AGREE_UM = const(600)
_TWICE_T = const(8)  # least time between two estimates that must agree
_OTHER = const(150_000)  # 1.1
_SLIDES_T = const(100)  # typing fingers touch together for less; as they lift, light changes
_DIPPED = const(435_000)  # 0.75, as difference of brightness in Q20 of log2
_SINGLE = const(419_000)  # 1.32
_GONE_T = const(25)  # before the last 10 ms of this time, nearly every finger has lifted


def slack_um(s, b_last):
    """Return the largest distance between two readings of a resting finger, in um.

    The readings are the present one and one with the brightness `b_last`; the darker is noisier.
    """
    return max(c.REST_UM, noise(s[c.NOISE_PRODUCT], min(s[c.B_NOW], b_last)) * 7 >> 1)


def beside(s):
    """Estimate a second finger in the present reading; assumes that the first finger rests."""
    return estimate(s, s[c.X_UM], s[c.B], s[c.FITS])


def guess(s):
    """Estimate a second finger beside the first one; return whether two estimates agree."""
    if not s[c.IS_EVEN]:
        agrees = s[c.RISES] and s[c.PAIR] and _guess_both(s)
    elif not estimate(s, s[c.X_UM], s[c.B], s[c.FITS]):
        s[c.GUESSED] = False
        if not may_be_still(s):
            s[c.IS_EVEN] = False
            s[c.FALLS] = True
            s[c.FELL] = s[c.T_NOW]
        return False
    else:
        slack_um = s[c.FOUND_SLACK_UM]
        agrees = s[c.GUESSED] and abs(s[c.FOUND_UM] - s[c.X_GUESS_UM]) <= _AGREE_UM + (
            slack_um + s[c.SLACK_GUESS_UM] >> 1
        )
        if agrees and (
            (s[c.T_NOW] - s[c.GUESSED_T]) & (c.TICKS - 1) < _TWICE_T
            or abs(s[c.FOUND_B] - s[c.B_GUESS]) <= _OTHER
        ):
            agrees = False  # no evidence: with the same shares of light, readings always agree
        else:
            s[c.GUESSED_T] = s[c.T_NOW]
            s[c.GUESSED] = True
            s[c.X_GUESS_UM] = s[c.FOUND_UM]
            s[c.SLACK_GUESS_UM] = slack_um
            s[c.B_GUESS] = s[c.FOUND_B]
            agrees = agrees and slack_um <= c.SURE_UM
    # When the first finger begins to lift, estimates move away from it.
    if s[c.GUESSED] and abs(s[c.X_GUESS_UM] - s[c.X_UM]) < abs(s[c.HINT_UM] - s[c.X_UM]):
        s[c.HINT_UM] = s[c.X_GUESS_UM]
    return agrees


def _guess_both(s):
    # Estimates both fingers from the present reading and the one before, because the light of the
    # first finger is unknown. Returns whether an earlier estimate agrees.
    if s[c.B_NOW] < s[c.B_LAST] + c.EVEN or not weigh(s) or s[c.FOUND_B] < s[c.B] - c.CALM:
        # A third reading may confirm the estimate from two readings, even if both fingers now rest.
        s[c.GUESSED] = (
            s[c.GUESSED]
            and estimate(s, s[c.X_UM], s[c.B_GUESS], s[c.FITS])
            and abs(s[c.FOUND_UM] - s[c.X_GUESS_UM]) <= _AGREE_UM + s[c.SLACK_GUESS_UM]
        )
        return s[c.GUESSED] and _confirm(s)
    at_um = s[c.FOUND_UM]
    slack_um = s[c.FOUND_SLACK_UM]
    agrees = (
        s[c.GUESSED] and abs(at_um - s[c.X_GUESS_UM]) <= _AGREE_UM + slack_um + s[c.SLACK_GUESS_UM]
    )
    if not agrees or slack_um < s[c.SLACK_GUESS_UM]:
        s[c.GUESSED] = True
        s[c.X_GUESS_UM] = at_um
        s[c.SLACK_GUESS_UM] = slack_um
        s[c.B_GUESS] = s[c.FOUND_B]
    return agrees and _confirm(s)


def _confirm(s):
    s[c.B] = s[c.B_GUESS]
    s[c.IS_EVEN] = True
    s[c.RISES] = False
    if s[c.SLACK_GUESS_UM] > c.SURE_UM or not beside(s):
        s[c.GUESSED] = False
        return False
    s[c.B_GUESS] = s[c.FOUND_B]
    return True


def recalls(s):
    """Estimate a second finger that rested, but was not found; return whether it is certain.

    One of the two fingers has left; the present reading is of the other one.
    """
    x_um = s[c.X_NOW_UM]
    b = s[c.B_NOW]
    # If the light changes, the finger at `x_um` lifts.
    if s[c.SECOND] or not s[c.B_BOTH] or abs(s[c.B_SINCE] - b) > c.EVEN:
        return False
    s[c.X_NOW_UM] = s[c.X_BOTH_UM]
    s[c.B_NOW] = s[c.B_BOTH]
    is_there = estimate(s, x_um, s[c.B_SINCE], s[c.FIT_BOTH])
    s[c.X_NOW_UM] = x_um
    s[c.B_NOW] = b
    if not is_there:
        return False
    at_um = s[c.FOUND_UM]
    slack_um = s[c.FOUND_SLACK_UM]
    return slack_um <= c.SURE_UM and abs(at_um - s[c.X_UM]) >= c.APART_UM + slack_um


def slides(s):
    """Follow a sliding second finger; return whether its position was updated.

    The position is not updated if the first finger may be lifting: a lift has a similar effect.
    """
    brightness = s[c.B_NOW]
    if (
        (s[c.T] - s[c.BEGAN]) & (c.TICKS - 1) < _SLIDES_T
        or (
            brightness < s[c.PEAK] - (c.RISEN >> 1)  # a finger that lifts loses light
            and estimate(s, s[c.X_SECOND_UM], s[c.B_SECOND], s[c.FITS])
            and abs(s[c.FOUND_UM] - s[c.X_UM]) < (s[c.FOUND_SLACK_UM] >> 1) + c.SAME_UM
        )
        or not beside(s)
    ):
        return False
    if abs(s[c.FOUND_UM] - s[c.X_SECOND_UM]) > 2 * c.APART_UM:
        return False
    s[c.X_SECOND_UM] = s[c.FOUND_UM]
    s[c.B_SECOND] = s[c.FOUND_B]
    s[c.PEAK] = brightness
    s[c.IS_EVEN] = True
    return True


def has_left(s, off_um):
    """Return whether the first finger has left.

    The measured position now stays, `off_um` um from the last position of the first finger.
    """
    brightness = s[c.B_NOW]
    if not s[c.SECOND] and brightness > s[c.B_SINCE] + _DIPPED:
        return True  # with two fingers, this change of force would move the position
    first = s[c.B]
    if s[c.SECOND]:
        apart_um = s[c.X_SECOND_UM] - s[c.X_UM]
        if off_um < 0:
            apart_um = -apart_um
        if abs(off_um) < apart_um - c.NEAR_UM and brightness < s[c.B_SINCE] - c.EVEN:
            return False  # both lift
        # There may be a third finger, and the second finger may not have left.
        return not estimate(s, s[c.X_SECOND_UM], s[c.B_SECOND] - _DIPPED, True)
    if s[c.FALLS]:
        return True  # while a finger lifts, the position would change
    # No second finger on the strip could cause this position while the first one rests.
    alone = (s[c.SEEN] > 1 or brightness < first + _SINGLE) and not estimate(
        s, s[c.X_UM], first - c.MORE, True
    )
    return alone or s[c.LEAST] < min(first, brightness) - _DIPPED


def remains(s):
    """Return whether only one finger remains: 0, `SINGLE`, `ENDS`, or the sum of both."""
    # At most 11 words in the call frame, see strip.py. With two fingers, this change of light would
    # move the position.
    if not s[c.KNOWN]:
        if s[c.B_NOW] < s[c.PEAK] - c.LOST and abs(s[c.X_NOW_UM] - s[c.X_PEAK_UM]) < slack_um(
            s, s[c.PEAK]
        ):
            return c.SINGLE
        return 0
    change = abs(s[c.B_NOW] - s[c.B_LAST])
    how = 0
    if change > c.CHANGED and abs(s[c.X_NOW_UM] - s[c.X_LAST_UM]) < max(
        c.REST_UM, min(abs(s[c.X_NOW_UM] - s[c.X_UM]), 100_000) * (change >> 12) >> 12
    ):
        how = c.SINGLE
    # While the first finger lifts, the position approaches the second finger, in ever smaller
    # steps. The remaining distance is about the square of a step divided by the step before.
    # Or the second finger was estimated here before.
    if (
        s[c.FALLS]
        and (s[c.T_NOW] - s[c.FELL]) & (c.TICKS - 1) >= c.LIFTS_T
        and (
            (
                -c.NEAR_UM < s[c.X_NOW_UM] - s[c.HINT_UM] < c.NEAR_UM
                and s[c.B_NOW] < s[c.PEAK] - c.EVEN
            )
            or (
                s[c.B_NOW] > s[c.B_LAST] - c.LOST
                and 0 < s[c.STEP_UM] < c.FAST_UM
                and s[c.STEP_UM] * s[c.STEP_UM] < s[c.STEP_LAST_UM] * _REMAINS_UM
            )
        )
    ):
        how |= c.ENDS
    return how


def passes(s):
    """Return whether only the second finger touched in the reading before, and now another one.

    While the first finger lifts, the position approaches the second finger. If it turns back before
    it has stayed anywhere, a further finger has touched, or the second one lifts.
    """
    return (
        s[c.FALLS]
        and s[c.STEP_UM] < -c.REST_UM
        and s[c.STEP_LAST_UM] > 0
        and (s[c.T_NOW] - s[c.FELL]) & (c.TICKS - 1) >= _GONE_T
        and abs(s[c.X_LAST_UM] - s[c.X_UM]) > c.APART_UM
    )


def was_second(s):
    """Return whether the last reading before the light ended was of the second finger alone."""
    return (
        s[c.KNOWN]
        and not s[c.SECOND]
        and s[c.FALLS]
        and s[c.FIT_SEEN]
        and (s[c.T_NOW] - s[c.FELL]) & (c.TICKS - 1) >= _GONE_T
        and abs(s[c.X_SEEN_UM] - s[c.X_UM]) - c.APART_UM
        > 2 * noise(s[c.NOISE_PRODUCT], s[c.B_SEEN])
    )
