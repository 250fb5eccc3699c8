"""Evidence about a second and a third finger, from readings of `contact.ContactTracker`.

The argument `s` of each function is the state of a tracker, whose elements contact.py describes.
The functions store their estimates in it; contact.py decides which fingers touch, and reports them.
Integers only; allocates nothing.
"""

try:
    from micropython import const
except ImportError:
    const = int  # on the host

from .locate import power
from .second import locate, may_rest, noise, weigh

_TIME_MASK = const((1 << 22) - 1)  # ticks as in contact.py
_AGREE_UM = const(600)
_SURE_UM = const(4000)
_TWICE_T = const(8)  # least time between two estimates that confirm each other
_SLIDES_T = const(100)  # fingers that type overlap for less: their light changes as they lift
_LAST_UM = const(4000)  # largest step at the end of a lift, if no more readings follow
_DIPPED = const(435_000)  # 0.75, as difference of brightness in Q20 of log2
_OTHER = const(150_000)  # 1.1
_SINGLE = const(419_000)  # 1.32

# Limits and elements of the state, with the values and the comments of contact.py. MicroPython
# replaces a `const` by its value in its own module only. A test compares the modules.
_SAME_UM = const(450)
_LOST = const(337_000)
_MORE = const(171_000)
_EVEN = const(74_000)
_NEAR_UM = const(2000)
_APART_UM = const(4500)
_RISEN = const(30_000)
_CALM = const(40_000)
_SOON = const(5)
_FOUND_UM = const(0)
_FOUND_SLACK_UM = const(1)
_FOUND_B = const(2)
_X_UM = const(4)
_KNOWN = const(6)
_SEEN = const(7)
_X_SEEN_UM = const(9)
_STEP_UM = const(11)
_B = const(12)
_B_SINCE = const(16)
_T = const(17)
_BEGAN = const(18)
_IS_EVEN = const(19)
_IS_CALM = const(20)
_RISES = const(21)
_FALLS = const(22)
_FELL = const(23)
_SECOND = const(24)
_X_SECOND_UM = const(25)
_B_SECOND = const(26)
_THIRD = const(27)
_PEAK = const(30)
_X_PEAK_UM = const(31)
_LEAST = const(33)
_X_BOTH_UM = const(36)
_B_BOTH = const(37)
_FIT_BOTH = const(38)
_GUESSED = const(39)
_GUESSED_T = const(40)
_X_GUESS_UM = const(41)
_B_GUESS = const(42)
_SLACK_GUESS_UM = const(43)
_DRIFTS = const(44)
_HAS_DIPPED = const(47)
_LENGTH_UM = const(-9)
_DECAY = const(-8)
_NOISE_PRODUCT = const(-7)


def solve(s, x1_um, b1, x_um, brightness, fits):
    """Estimate a finger beside another one, which has position `x1_um` and brightness `b1`.

    The other arguments are a reading, see `second.locate`. Stores the result in three elements of
    the state, from `_FOUND_UM` on. Returns whether there is a solution on the strip.
    """
    return (
        s[_LENGTH_UM]
        and locate(
            s,
            s[_DECAY],
            x1_um,
            b1,
            x_um,
            brightness,
            -1 if s[_DRIFTS] else fits,
            noise(s[_NOISE_PRODUCT], brightness),
        )
        and -_NEAR_UM - s[_FOUND_SLACK_UM]
        < s[_FOUND_UM]
        < s[_LENGTH_UM] + _NEAR_UM + s[_FOUND_SLACK_UM]
    )


def guess(s, fits, x_um, brightness, t):
    """Estimate a second finger while the first one rests; return whether two estimates agree.

    The arguments are a reading, as in `second.locate`, and its time.
    """
    if not solve(s, s[_X_UM], s[_B], x_um, brightness, fits):
        s[_GUESSED] = False
        end_um = s[_LENGTH_UM] + _NEAR_UM if x_um > s[_X_UM] else -_NEAR_UM
        if not may_rest(s[_DECAY], s[_X_UM], s[_B] - _EVEN, end_um, x_um, brightness):
            # The first finger became dimmer, even if the second finger is at the strip's end.
            s[_IS_EVEN] = False
            s[_FALLS] = True
            s[_FELL] = t
        return False
    at_um = s[_FOUND_UM]
    slack_um = s[_FOUND_SLACK_UM]
    b = s[_FOUND_B]
    if s[_IS_CALM]:
        slack_um >>= 1
    agrees = s[_GUESSED] and abs(at_um - s[_X_GUESS_UM]) <= _AGREE_UM + (
        slack_um + s[_SLACK_GUESS_UM] >> 1
    )
    if agrees and (
        (t - s[_GUESSED_T]) & _TIME_MASK < _TWICE_T
        or (abs(b - s[_B_GUESS]) <= _OTHER and (fits or not s[_IS_CALM]))
    ):
        return False  # no evidence: the same share of light always gives the same position
    s[_GUESSED_T] = t
    s[_GUESSED] = True
    s[_X_GUESS_UM] = at_um
    s[_SLACK_GUESS_UM] = slack_um
    s[_B_GUESS] = b
    return agrees and slack_um <= _SURE_UM


def guess_both(s, fits, x_last_um, b_last, x_um, brightness):
    """Estimate both fingers from two readings, if the light of the first finger is unknown.

    The arguments are position and brightness of the last reading, and the present reading, as in
    `second.locate`. Returns whether an earlier estimate agrees.
    """
    limit_um = s[_LENGTH_UM] + _NEAR_UM if x_um > s[_X_UM] else -_NEAR_UM
    if (
        brightness < b_last + _EVEN
        or not weigh(s, s[_DECAY], s[_X_UM], limit_um, x_last_um, b_last, x_um, brightness)
        or s[_FOUND_B] < s[_B] - _CALM
    ):
        # A third reading confirms an earlier estimate, because its light differs.
        s[_GUESSED] = (
            s[_GUESSED]
            and solve(s, s[_X_UM], s[_B_GUESS], x_um, brightness, fits)
            and abs(s[_FOUND_UM] - s[_X_GUESS_UM]) <= _AGREE_UM + s[_SLACK_GUESS_UM]
        )
        return s[_GUESSED] and _confirm(s, fits, x_um, brightness)
    at_um = s[_FOUND_UM]
    slack_um = s[_FOUND_SLACK_UM]
    b = s[_FOUND_B]
    agrees = (
        s[_GUESSED] and abs(at_um - s[_X_GUESS_UM]) <= _AGREE_UM + slack_um + s[_SLACK_GUESS_UM]
    )
    if not agrees or slack_um < s[_SLACK_GUESS_UM]:
        s[_GUESSED] = True
        s[_X_GUESS_UM] = at_um
        s[_SLACK_GUESS_UM] = slack_um
        s[_B_GUESS] = b
    return agrees and _confirm(s, fits, x_um, brightness)


def _confirm(s, fits, x_um, brightness):
    s[_B] = s[_B_GUESS]
    s[_IS_EVEN] = True
    s[_RISES] = False
    if s[_SLACK_GUESS_UM] > _SURE_UM or not solve(s, s[_X_UM], s[_B], x_um, brightness, fits):
        s[_GUESSED] = False
        return False
    s[_B_GUESS] = s[_FOUND_B]
    return True


def recalls(s, x_um, brightness):
    """Estimate a second finger that rested, but was not found; return whether it is certain.

    One of the two fingers has left; the present reading is of the other one, at `x_um`.
    """
    if (
        s[_SECOND]
        or not s[_B_BOTH]
        or abs(s[_B_SINCE] - brightness) > _EVEN  # the finger at `x_um` lifts
        or not solve(s, x_um, s[_B_SINCE], s[_X_BOTH_UM], s[_B_BOTH], s[_FIT_BOTH])
    ):
        return False
    at_um = s[_FOUND_UM]
    slack_um = s[_FOUND_SLACK_UM]
    return slack_um <= _SURE_UM and abs(at_um - s[_X_UM]) >= _APART_UM + slack_um


def slides(s, fits, x_um, brightness):
    """Follow a sliding second finger; return whether its position was updated.

    It is not updated if the first finger may be lifting, because that has a similar effect. The
    arguments are a reading, as in `second.locate`.
    """
    if (
        (s[_T] - s[_BEGAN]) & _TIME_MASK < _SLIDES_T
        or (
            brightness < s[_PEAK] - (_RISEN >> 1)  # a finger that lifts loses light
            and solve(s, s[_X_SECOND_UM], s[_B_SECOND], x_um, brightness, fits)
            and abs(s[_FOUND_UM] - s[_X_UM]) < (s[_FOUND_SLACK_UM] >> 1) + _SAME_UM
        )
        or not solve(s, s[_X_UM], s[_B], x_um, brightness, fits)
    ):
        return False
    if abs(s[_FOUND_UM] - s[_X_SECOND_UM]) > 2 * _APART_UM:
        return False
    s[_X_SECOND_UM] = s[_FOUND_UM]
    s[_B_SECOND] = s[_FOUND_B]
    s[_PEAK] = brightness
    s[_IS_EVEN] = True
    return True


def find_third(s, x0_um, b0, fits, x_um, brightness):
    """Estimate a third finger beside the position `x0_um` with the brightness `b0`.

    `x0_um` is the position of the second finger if the first one has left; else the common
    position of both fingers. The other arguments are a reading, as in `second.locate`. Returns the
    uncertainty of the third finger's position in um, or 0 until two readings agree on this
    position. While the first finger lifts, readings do not agree.
    """
    agrees = s[_GUESSED]
    last_um = s[_X_GUESS_UM]
    s[_GUESSED] = (
        solve(s, x0_um, b0, x_um, brightness, fits)
        and abs(s[_FOUND_UM] - s[_X_UM]) > _APART_UM
        and abs(s[_FOUND_UM] - s[_X_SECOND_UM]) > _APART_UM
    )
    s[_X_GUESS_UM] = at_um = s[_FOUND_UM]
    s[_B_GUESS] = s[_FOUND_B]
    if not (agrees and s[_GUESSED]) or abs(at_um - last_um) > _APART_UM:
        return 0
    return (s[_FOUND_SLACK_UM] * _SOON >> 3) + abs(last_um - at_um)


def has_left(s, off_um, brightness):
    """Return whether the first finger has left.

    The measured position now rests, `off_um` um from the last position of the first finger.
    """
    if not s[_SECOND] and brightness > s[_B_SINCE] + _DIPPED:
        return True  # with two fingers, this change of force would move the position
    first = s[_B]
    if s[_SECOND]:
        apart_um = s[_X_SECOND_UM] - s[_X_UM]
        if off_um < 0:
            apart_um = -apart_um
        if abs(off_um) < apart_um - _NEAR_UM and brightness < s[_B_SINCE] - _EVEN:
            return False  # both lift
        # There may be a third finger, and the second finger may not have left.
        return not solve(
            s,
            s[_X_SECOND_UM],
            s[_B_SECOND] - _DIPPED,
            s[_X_UM] + off_um,
            brightness,
            True,
        )
    if s[_FALLS] and not s[_THIRD]:
        return True  # while a finger lifts, the position would change
    x_um = s[_X_UM] + off_um
    # No second finger on the strip could cause this position while the first one rests.
    alone = (s[_SEEN] > 1 or brightness < first + _SINGLE) and not solve(
        s, s[_X_UM], first - _MORE, x_um, brightness, True
    )
    if s[_THIRD]:
        # Return True only if the light is too low for two fingers.
        return brightness < s[_PEAK] - _LOST and (alone or brightness < first + _SINGLE)
    if alone:
        return True
    if s[_HAS_DIPPED] or s[_LEAST] < min(first, brightness) - _DIPPED:
        return True
    light_first = power(first) >> 6  # sixteenths of a count
    peak = power(s[_PEAK]) >> 6
    if power(brightness) >> 6 >= peak - light_first // 5:
        return False
    # Light was lost while the position moved away from the first finger.
    away_um = x_um - s[_X_PEAK_UM]
    if off_um < 0:
        away_um = -away_um
    return away_um > (abs(off_um) >> 5) * ((light_first << 4) // (peak + 1)) // 10


def has_almost_left(s):
    """Return whether the last reading is almost that of an unknown second finger alone.

    True if the first finger was lifting, and the position was near the end of its motion.
    """
    return (
        s[_KNOWN]
        and s[_FALLS]
        and not (s[_SECOND] or s[_THIRD])
        and s[_SEEN] >= 0
        and abs(s[_STEP_UM]) < _LAST_UM
        and abs(s[_X_SEEN_UM] - s[_X_UM]) > _APART_UM
    )
