"""Evidence about a second and a third finger, from readings of `contact.ContactTracker`.

The argument `s` of each function is the state of a tracker, see contact_state.py.
The functions store their estimates in it; contact.py decides which fingers touch, and reports them.
Integers only; allocates nothing.
"""

from .. import const
from .locate import estimate, noise, power
from .second import may_rest, weigh
from .state import (
    APART_UM,
    B_BOTH,
    B_GUESS,
    B_LAST,
    B_NOW,
    B_SECOND,
    B_SEEN,
    B_SINCE,
    BEGAN,
    CALM,
    ENDS,
    EVEN,
    FALLS,
    FELL,
    FIT_BOTH,
    FITS,
    FOUND_B,
    FOUND_SLACK_UM,
    FOUND_UM,
    GUESSED,
    GUESSED_T,
    HAS_DIPPED,
    HINT_UM,
    IS_CALM,
    IS_EVEN,
    KNOWN,
    LEAST,
    LIFTS_T,
    LOST,
    MORE,
    NEAR_UM,
    NOISE_PRODUCT,
    PAIR,
    PEAK,
    REST_UM,
    RISEN,
    RISES,
    SAME_UM,
    SECOND,
    SEEN,
    SINGLE,
    SLACK_GUESS_UM,
    STEP_LAST_UM,
    STEP_UM,
    SURE_UM,
    T_NOW,
    THIRD,
    TICKS,
    X_BOTH_UM,
    X_GUESS_UM,
    X_LAST_UM,
    X_NOW_UM,
    X_PEAK_UM,
    X_SECOND_UM,
    X_SEEN_UM,
    X_UM,
    B,
    T,
)

_REMAINS_UM = const(2000)  # largest distance to the second finger at the end of a lift
_FAST_UM = const(20_000)
_CHANGED = const(150_000)  # 1.1
_AGREE_UM = const(600)
_TWICE_T = const(8)  # least time between two estimates that must agree
_OTHER = const(150_000)  # 1.1
_SLIDES_T = const(100)  # typing fingers touch together for less; as they lift, light changes
_LAST_UM = const(4000)  # largest step at the end of a lift, if no more readings follow
_DIPPED = const(435_000)  # 0.75, as difference of brightness in Q20 of log2
_SINGLE = const(419_000)  # 1.32


def slack_um(s, b_last):
    """Return the largest distance between two readings of a resting finger, in um.

    The readings are the present one and one with the brightness `b_last`; the darker is noisier.
    """
    return max(REST_UM, noise(s[NOISE_PRODUCT], min(s[B_NOW], b_last)) * 7 >> 1)


def beside(s):
    """Estimate a second finger in the present reading; assumes that the first finger rests."""
    return estimate(s, s[X_UM], s[B], s[FITS])


def guess(s):
    """Estimate a second finger beside the first one; return whether two estimates agree."""
    if not s[IS_EVEN]:
        agrees = s[RISES] and s[PAIR] and _guess_both(s)
    elif not estimate(s, s[X_UM], s[B], s[FITS]):
        s[GUESSED] = False
        if not may_rest(s):
            s[IS_EVEN] = False
            s[FALLS] = True
            s[FELL] = s[T_NOW]
        return False
    else:
        slack_um = s[FOUND_SLACK_UM]
        if s[IS_CALM]:
            slack_um >>= 1
        agrees = s[GUESSED] and abs(s[FOUND_UM] - s[X_GUESS_UM]) <= _AGREE_UM + (
            slack_um + s[SLACK_GUESS_UM] >> 1
        )
        if agrees and (
            (s[T_NOW] - s[GUESSED_T]) & (TICKS - 1) < _TWICE_T
            or (abs(s[FOUND_B] - s[B_GUESS]) <= _OTHER and (s[FITS] or not s[IS_CALM]))
        ):
            agrees = False  # no evidence: with the same shares of light, readings always agree
        else:
            s[GUESSED_T] = s[T_NOW]
            s[GUESSED] = True
            s[X_GUESS_UM] = s[FOUND_UM]
            s[SLACK_GUESS_UM] = slack_um
            s[B_GUESS] = s[FOUND_B]
            agrees = agrees and slack_um <= SURE_UM
    # When the first finger begins to lift, estimates move away from it.
    if s[GUESSED] and abs(s[X_GUESS_UM] - s[X_UM]) < abs(s[HINT_UM] - s[X_UM]):
        s[HINT_UM] = s[X_GUESS_UM]
    return agrees


def _guess_both(s):
    # Estimates both fingers from the present reading and the one before, because the light of the
    # first finger is unknown. Returns whether an earlier estimate agrees.
    if s[B_NOW] < s[B_LAST] + EVEN or not weigh(s) or s[FOUND_B] < s[B] - CALM:
        # A third reading may confirm the estimate from two readings, even if both fingers now rest.
        s[GUESSED] = (
            s[GUESSED]
            and estimate(s, s[X_UM], s[B_GUESS], s[FITS])
            and abs(s[FOUND_UM] - s[X_GUESS_UM]) <= _AGREE_UM + s[SLACK_GUESS_UM]
        )
        return s[GUESSED] and _confirm(s)
    at_um = s[FOUND_UM]
    slack_um = s[FOUND_SLACK_UM]
    agrees = s[GUESSED] and abs(at_um - s[X_GUESS_UM]) <= _AGREE_UM + slack_um + s[SLACK_GUESS_UM]
    if not agrees or slack_um < s[SLACK_GUESS_UM]:
        s[GUESSED] = True
        s[X_GUESS_UM] = at_um
        s[SLACK_GUESS_UM] = slack_um
        s[B_GUESS] = s[FOUND_B]
    return agrees and _confirm(s)


def _confirm(s):
    s[B] = s[B_GUESS]
    s[IS_EVEN] = True
    s[RISES] = False
    if s[SLACK_GUESS_UM] > SURE_UM or not beside(s):
        s[GUESSED] = False
        return False
    s[B_GUESS] = s[FOUND_B]
    return True


def recalls(s):
    """Estimate a second finger that rested, but was not found; return whether it is certain.

    One of the two fingers has left; the present reading is of the other one.
    """
    x_um = s[X_NOW_UM]
    b = s[B_NOW]
    # If the light changes, the finger at `x_um` lifts.
    if s[SECOND] or not s[B_BOTH] or abs(s[B_SINCE] - b) > EVEN:
        return False
    s[X_NOW_UM] = s[X_BOTH_UM]
    s[B_NOW] = s[B_BOTH]
    is_there = estimate(s, x_um, s[B_SINCE], s[FIT_BOTH])
    s[X_NOW_UM] = x_um
    s[B_NOW] = b
    if not is_there:
        return False
    at_um = s[FOUND_UM]
    slack_um = s[FOUND_SLACK_UM]
    return slack_um <= SURE_UM and abs(at_um - s[X_UM]) >= APART_UM + slack_um


def slides(s):
    """Follow a sliding second finger; return whether its position was updated.

    The position is not updated if the first finger may be lifting: a lift has a similar effect.
    """
    brightness = s[B_NOW]
    if (
        (s[T] - s[BEGAN]) & (TICKS - 1) < _SLIDES_T
        or (
            brightness < s[PEAK] - (RISEN >> 1)  # a finger that lifts loses light
            and estimate(s, s[X_SECOND_UM], s[B_SECOND], s[FITS])
            and abs(s[FOUND_UM] - s[X_UM]) < (s[FOUND_SLACK_UM] >> 1) + SAME_UM
        )
        or not beside(s)
    ):
        return False
    if abs(s[FOUND_UM] - s[X_SECOND_UM]) > 2 * APART_UM:
        return False
    s[X_SECOND_UM] = s[FOUND_UM]
    s[B_SECOND] = s[FOUND_B]
    s[PEAK] = brightness
    s[IS_EVEN] = True
    return True


def has_left(s, off_um):
    """Return whether the first finger has left.

    The measured position now stays, `off_um` um from the last position of the first finger.
    """
    brightness = s[B_NOW]
    if not s[SECOND] and brightness > s[B_SINCE] + _DIPPED:
        return True  # with two fingers, this change of force would move the position
    first = s[B]
    if s[SECOND]:
        apart_um = s[X_SECOND_UM] - s[X_UM]
        if off_um < 0:
            apart_um = -apart_um
        if abs(off_um) < apart_um - NEAR_UM and brightness < s[B_SINCE] - EVEN:
            return False  # both lift
        # There may be a third finger, and the second finger may not have left.
        return not estimate(s, s[X_SECOND_UM], s[B_SECOND] - _DIPPED, True)
    if s[FALLS] and not s[THIRD]:
        return True  # while a finger lifts, the position would change
    # No second finger on the strip could cause this position while the first one rests.
    alone = (s[SEEN] > 1 or brightness < first + _SINGLE) and not estimate(
        s, s[X_UM], first - MORE, True
    )
    if s[THIRD]:
        # Return True only if the light is too low for two fingers.
        return brightness < s[PEAK] - LOST and (alone or brightness < first + _SINGLE)
    if alone:
        return True
    if s[HAS_DIPPED] or s[LEAST] < min(first, brightness) - _DIPPED:
        return True
    light_first = power(first) >> 6  # sixteenths of a count
    peak = power(s[PEAK]) >> 6
    if power(brightness) >> 6 >= peak - light_first // 5:
        return False
    # Light was lost while the position moved away from the first finger.
    away_um = s[X_NOW_UM] - s[X_PEAK_UM]
    if off_um < 0:
        away_um = -away_um
    return away_um > (abs(off_um) >> 5) * ((light_first << 4) // (peak + 1)) // 10


def remains(s):
    """Return whether only one finger remains: 0, `SINGLE`, `ENDS`, or the sum of both."""
    # At most 11 words in the call frame, see strip.py. With two fingers, this change of light would
    # move the position.
    change = abs(s[B_NOW] - s[B_LAST])
    how = 0
    if change > _CHANGED and abs(s[X_NOW_UM] - s[X_LAST_UM]) < max(
        REST_UM, min(abs(s[X_NOW_UM] - s[X_UM]), 100_000) * (change >> 12) >> 12
    ):
        how = SINGLE
    # While the first finger lifts, the position approaches the second finger, in ever smaller
    # steps. The remaining distance is about the square of a step divided by the step before.
    # Or the second finger was estimated here before.
    if (-NEAR_UM < s[X_NOW_UM] - s[HINT_UM] < NEAR_UM and s[B_NOW] < s[PEAK] - EVEN) or (
        s[FALLS]
        and not s[THIRD]
        and (s[T_NOW] - s[FELL]) & (TICKS - 1) >= LIFTS_T
        and s[B_NOW] > s[B_LAST] - LOST
        and 0 < s[STEP_UM] < _FAST_UM
        and s[STEP_UM] * s[STEP_UM] < s[STEP_LAST_UM] * _REMAINS_UM
    ):
        how |= ENDS
    return how


def has_almost_left(s):
    """Return whether the measured position has almost reached an unknown second finger.

    True if the first finger was lifting, and the last step of the position was small.
    """
    return (
        s[KNOWN]
        and s[FALLS]
        and not (s[SECOND] or s[THIRD])
        and s[SEEN] >= 0
        and abs(s[STEP_UM]) < _LAST_UM
        and abs(s[X_SEEN_UM] - s[X_UM]) > APART_UM + 2 * noise(s[NOISE_PRODUCT], s[B_SEEN])
    )
