"""Evidence about a second and a third finger, from readings of `contact.ContactTracker`.

The argument `s` of each function is the state of a tracker, whose elements contact.py describes.
The functions store their estimates in it; contact.py decides which fingers touch, and reports them.
Integers only; allocates nothing.
"""

try:
    from micropython import const
except ImportError:
    const = int  # on the host

from .contact_state import (
    APART_UM,
    B_BOTH,
    B_GUESS,
    B_SECOND,
    B_SINCE,
    BEGAN,
    CALM,
    DECAY,
    DRIFTS,
    EVEN,
    FALLS,
    FELL,
    FIT_BOTH,
    FOUND_B,
    FOUND_SLACK_UM,
    FOUND_UM,
    GUESSED,
    GUESSED_T,
    HAS_DIPPED,
    IS_CALM,
    IS_EVEN,
    KNOWN,
    LEAST,
    LENGTH_UM,
    LOST,
    MORE,
    NEAR_UM,
    NOISE_PRODUCT,
    PEAK,
    RISEN,
    RISES,
    SAME_UM,
    SECOND,
    SEEN,
    SLACK_GUESS_UM,
    SOON,
    STEP_UM,
    THIRD,
    TICKS,
    X_BOTH_UM,
    X_GUESS_UM,
    X_PEAK_UM,
    X_SECOND_UM,
    X_SEEN_UM,
    X_UM,
    B,
    T,
)
from .locate import power
from .second import locate, may_rest, noise, weigh

_AGREE_UM = const(600)
_SURE_UM = const(4000)
_TWICE_T = const(8)  # least time between two estimates that confirm each other
_SLIDES_T = const(100)  # fingers that type overlap for less: their light changes as they lift
_LAST_UM = const(4000)  # largest step at the end of a lift, if no more readings follow
_DIPPED = const(435_000)  # 0.75, as difference of brightness in Q20 of log2
_OTHER = const(150_000)  # 1.1
_SINGLE = const(419_000)  # 1.32


def solve(s, x1_um, b1, x_um, brightness, fits):
    """Estimate a finger beside another one, which has position `x1_um` and brightness `b1`.

    The other arguments are a reading, see `second.locate`. Stores the result in three elements of
    the state, from `FOUND_UM` on. Returns whether there is a solution on the strip.
    """
    return (
        s[LENGTH_UM]
        and locate(
            s,
            s[DECAY],
            x1_um,
            b1,
            x_um,
            brightness,
            -1 if s[DRIFTS] else fits,
            noise(s[NOISE_PRODUCT], brightness),
        )
        and -NEAR_UM - s[FOUND_SLACK_UM] < s[FOUND_UM] < s[LENGTH_UM] + NEAR_UM + s[FOUND_SLACK_UM]
    )


def guess(s, fits, x_um, brightness, t):
    """Estimate a second finger while the first one rests; return whether two estimates agree.

    The arguments are a reading, as in `second.locate`, and its time.
    """
    if not solve(s, s[X_UM], s[B], x_um, brightness, fits):
        s[GUESSED] = False
        end_um = s[LENGTH_UM] + NEAR_UM if x_um > s[X_UM] else -NEAR_UM
        if not may_rest(s[DECAY], s[X_UM], s[B] - EVEN, end_um, x_um, brightness):
            # The first finger became dimmer, even if the second finger is at the strip's end.
            s[IS_EVEN] = False
            s[FALLS] = True
            s[FELL] = t
        return False
    at_um = s[FOUND_UM]
    slack_um = s[FOUND_SLACK_UM]
    b = s[FOUND_B]
    if s[IS_CALM]:
        slack_um >>= 1
    agrees = s[GUESSED] and abs(at_um - s[X_GUESS_UM]) <= _AGREE_UM + (
        slack_um + s[SLACK_GUESS_UM] >> 1
    )
    if agrees and (
        (t - s[GUESSED_T]) & (TICKS - 1) < _TWICE_T
        or (abs(b - s[B_GUESS]) <= _OTHER and (fits or not s[IS_CALM]))
    ):
        return False  # no evidence: the same share of light always gives the same position
    s[GUESSED_T] = t
    s[GUESSED] = True
    s[X_GUESS_UM] = at_um
    s[SLACK_GUESS_UM] = slack_um
    s[B_GUESS] = b
    return agrees and slack_um <= _SURE_UM


def guess_both(s, fits, x_last_um, b_last, x_um, brightness):
    """Estimate both fingers from two readings, if the light of the first finger is unknown.

    The arguments are position and brightness of the last reading, and the present reading, as in
    `second.locate`. Returns whether an earlier estimate agrees.
    """
    limit_um = s[LENGTH_UM] + NEAR_UM if x_um > s[X_UM] else -NEAR_UM
    if (
        brightness < b_last + EVEN
        or not weigh(s, s[DECAY], s[X_UM], limit_um, x_last_um, b_last, x_um, brightness)
        or s[FOUND_B] < s[B] - CALM
    ):
        # A third reading confirms an earlier estimate, because its light differs.
        s[GUESSED] = (
            s[GUESSED]
            and solve(s, s[X_UM], s[B_GUESS], x_um, brightness, fits)
            and abs(s[FOUND_UM] - s[X_GUESS_UM]) <= _AGREE_UM + s[SLACK_GUESS_UM]
        )
        return s[GUESSED] and _confirm(s, fits, x_um, brightness)
    at_um = s[FOUND_UM]
    slack_um = s[FOUND_SLACK_UM]
    b = s[FOUND_B]
    agrees = s[GUESSED] and abs(at_um - s[X_GUESS_UM]) <= _AGREE_UM + slack_um + s[SLACK_GUESS_UM]
    if not agrees or slack_um < s[SLACK_GUESS_UM]:
        s[GUESSED] = True
        s[X_GUESS_UM] = at_um
        s[SLACK_GUESS_UM] = slack_um
        s[B_GUESS] = b
    return agrees and _confirm(s, fits, x_um, brightness)


def _confirm(s, fits, x_um, brightness):
    s[B] = s[B_GUESS]
    s[IS_EVEN] = True
    s[RISES] = False
    if s[SLACK_GUESS_UM] > _SURE_UM or not solve(s, s[X_UM], s[B], x_um, brightness, fits):
        s[GUESSED] = False
        return False
    s[B_GUESS] = s[FOUND_B]
    return True


def recalls(s, x_um, brightness):
    """Estimate a second finger that rested, but was not found; return whether it is certain.

    One of the two fingers has left; the present reading is of the other one, at `x_um`.
    """
    if (
        s[SECOND]
        or not s[B_BOTH]
        or abs(s[B_SINCE] - brightness) > EVEN  # the finger at `x_um` lifts
        or not solve(s, x_um, s[B_SINCE], s[X_BOTH_UM], s[B_BOTH], s[FIT_BOTH])
    ):
        return False
    at_um = s[FOUND_UM]
    slack_um = s[FOUND_SLACK_UM]
    return slack_um <= _SURE_UM and abs(at_um - s[X_UM]) >= APART_UM + slack_um


def slides(s, fits, x_um, brightness):
    """Follow a sliding second finger; return whether its position was updated.

    It is not updated if the first finger may be lifting, because that has a similar effect. The
    arguments are a reading, as in `second.locate`.
    """
    if (
        (s[T] - s[BEGAN]) & (TICKS - 1) < _SLIDES_T
        or (
            brightness < s[PEAK] - (RISEN >> 1)  # a finger that lifts loses light
            and solve(s, s[X_SECOND_UM], s[B_SECOND], x_um, brightness, fits)
            and abs(s[FOUND_UM] - s[X_UM]) < (s[FOUND_SLACK_UM] >> 1) + SAME_UM
        )
        or not solve(s, s[X_UM], s[B], x_um, brightness, fits)
    ):
        return False
    if abs(s[FOUND_UM] - s[X_SECOND_UM]) > 2 * APART_UM:
        return False
    s[X_SECOND_UM] = s[FOUND_UM]
    s[B_SECOND] = s[FOUND_B]
    s[PEAK] = brightness
    s[IS_EVEN] = True
    return True


def find_third(s, x0_um, b0, fits, x_um, brightness):
    """Estimate a third finger beside the position `x0_um` with the brightness `b0`.

    `x0_um` is the position of the second finger if the first one has left; else the common
    position of both fingers. The other arguments are a reading, as in `second.locate`. Returns the
    uncertainty of the third finger's position in um, or 0 until two readings agree on this
    position. While the first finger lifts, readings do not agree.
    """
    agrees = s[GUESSED]
    last_um = s[X_GUESS_UM]
    s[GUESSED] = (
        solve(s, x0_um, b0, x_um, brightness, fits)
        and abs(s[FOUND_UM] - s[X_UM]) > APART_UM
        and abs(s[FOUND_UM] - s[X_SECOND_UM]) > APART_UM
    )
    s[X_GUESS_UM] = at_um = s[FOUND_UM]
    s[B_GUESS] = s[FOUND_B]
    if not (agrees and s[GUESSED]) or abs(at_um - last_um) > APART_UM:
        return 0
    return (s[FOUND_SLACK_UM] * SOON >> 3) + abs(last_um - at_um)


def has_left(s, off_um, brightness):
    """Return whether the first finger has left.

    The measured position now rests, `off_um` um from the last position of the first finger.
    """
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
        return not solve(
            s,
            s[X_SECOND_UM],
            s[B_SECOND] - _DIPPED,
            s[X_UM] + off_um,
            brightness,
            True,
        )
    if s[FALLS] and not s[THIRD]:
        return True  # while a finger lifts, the position would change
    x_um = s[X_UM] + off_um
    # No second finger on the strip could cause this position while the first one rests.
    alone = (s[SEEN] > 1 or brightness < first + _SINGLE) and not solve(
        s, s[X_UM], first - MORE, x_um, brightness, True
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
    away_um = x_um - s[X_PEAK_UM]
    if off_um < 0:
        away_um = -away_um
    return away_um > (abs(off_um) >> 5) * ((light_first << 4) // (peak + 1)) // 10


def has_almost_left(s):
    """Return whether the last reading is almost that of an unknown second finger alone.

    True if the first finger was lifting, and the position was near the end of its motion.
    """
    return (
        s[KNOWN]
        and s[FALLS]
        and not (s[SECOND] or s[THIRD])
        and s[SEEN] >= 0
        and abs(s[STEP_UM]) < _LAST_UM
        and abs(s[X_SEEN_UM] - s[X_UM]) > APART_UM
    )
