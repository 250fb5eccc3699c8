"""Compares a reading with earlier ones while there may be two fingers; finds what has happened.

`contact.ContactTracker` then reports it.

Boards with ``viper = true`` in board.toml get pair_viper.py instead of this file: `watch` with
identical results, in machine code. Integers only; allocates nothing.
"""

from .. import const
from ..reading.decode import (
    MISFIT,
    NOT_CALIBRATED,
    SATURATED,
    TOO_DARK,
    TOUCHING,
)
from .evidence import guess, has_almost_left, remains, slides
from .locate import estimate, noise
from .state import (
    APART_UM,
    B_BOTH,
    B_GUESS,
    B_LAST,
    B_NOW,
    B_PAIR,
    B_SECOND,
    B_SEEN,
    B_SINCE,
    CALM,
    CHECKED,
    ENDS,
    EVEN,
    FADED,
    FALLS,
    FELL,
    FIT_BOTH,
    FIT_SEEN,
    FITS,
    FLAGS_NOW,
    FORCE_MN,
    FORCE_NOW_MN,
    FOUND,
    FOUND_B,
    FOUND_SLACK_UM,
    FOUND_UM,
    GUESSED,
    HAS_DIPPED,
    IS_EVEN,
    KNOWN,
    LEAST,
    LEAVING,
    LENGTH_UM,
    LIFTED,
    LIFTS_T,
    LOST,
    LOW,
    MORE,
    MOVED,
    NEAR_UM,
    NEXT,
    NOISE_PRODUCT,
    ODD,
    PAIR,
    PEAK,
    RELEASE_MN,
    REMAINS,
    REST_UM,
    RESTED,
    RISEN,
    RISES,
    SAME,
    SECOND,
    SEEN,
    SINCE,
    SINGLE,
    SOON,
    STEP_LAST_UM,
    STEP_UM,
    STUCK_T,
    T_NOW,
    THIRD,
    TICKS,
    X_BOTH_UM,
    X_GUESS_UM,
    X_LAST_UM,
    X_NOW_UM,
    X_PAIR_UM,
    X_PEAK_UM,
    X_SECOND_UM,
    X_SEEN_UM,
    X_UM,
    B,
    T,
)

_REST_T = const(12)  # least time for which the position must stay
_FALL_T = const(34)  # longest time in which a finger lifts
# Limits for the detection of a third finger.
_GROWN = const(116_000)  # 1.08
_BOTH = const(397_000)  # 1.3


def watch(s, late, b, state):
    """Compare a reading with the readings before; return what has happened.

    Parameters
    ----------
    s, late, state : array.array
        State `TWO` of a `contact.ContactTracker` with the present reading, see contact_state.py.
        All three are the same array: machine code uses it as two pointers and as an object.
    b : int
        Brightness of the reading, element `B_NOW`.

    Returns
    -------
    int
        0 if there is nothing to report; else a number or bits from contact_state.py, such as
        `MOVED` or `FOUND | REMAINS`. -1 if the reading needs the checks in
        `contact.ContactTracker.take`; the state is then unchanged.
    """
    flags = s[FLAGS_NOW]
    if not flags & CHECKED:
        if (
            flags & (TOUCHING | NOT_CALIBRATED | SATURATED) != TOUCHING
            or (s[FORCE_NOW_MN] < s[RELEASE_MN] and not flags & (MISFIT | TOO_DARK))
            or s[STUCK_T]
            or not s[LENGTH_UM]
        ):
            return -1
        if s[LEAVING]:
            s[LEAVING] = False
            s[HAS_DIPPED] = True
        s[FITS] = not flags & MISFIT or flags & TOO_DARK > 0
        if s[FITS]:
            s[FORCE_MN] = s[FORCE_NOW_MN]
    # While the first finger lifts, the light decreases. If it grows, a third finger arrives.
    if (
        b > s[B_SEEN] + RISEN
        and (s[T] - s[FELL]) & (TICKS - 1) >= LIFTS_T
        and has_almost_left(state)
    ):
        return NEXT
    # The light of two fingers decreased and grows again: there may be a third finger.
    if s[LOW] < s[PEAK] - LOST and b > s[LOW] + _GROWN and s[PEAK] > s[B] + _BOTH:
        s[THIRD] = True
    _compare(s)
    if not s[FITS]:
        s[ODD] = True
    what = 0
    if s[FITS] and s[KNOWN] and s[PAIR] and not s[SECOND]:
        what = remains(state)
    if b < s[PEAK] - EVEN and not (
        s[SECOND] and not s[FALLS] and b > s[B_LAST] - EVEN and slides(state)
    ):
        s[IS_EVEN] = s[RISES] = False  # the first finger may be leaving
        if s[KNOWN] and not s[FALLS] and b < s[B_LAST] - CALM and s[STEP_UM] > REST_UM:
            s[FALLS] = True
            s[FELL] = s[T_NOW]
    if s[SECOND]:
        done = _resolve(s)
        if done >= 0:
            s[T] = s[T_NOW]
            return done
    else:
        s[X_PAIR_UM] = s[X_NOW_UM]
        s[B_PAIR] = b
        if not (s[THIRD] or s[HAS_DIPPED]) and guess(state):
            what |= FOUND
    s[PAIR] = True
    if what & (SINGLE | ENDS) or (
        s[SEEN] >= 1 and ((s[T_NOW] - s[SINCE]) & (TICKS - 1)) * (s[SEEN] + 1) >= _REST_T * s[SEEN]
    ):
        what |= REMAINS
    s[T] = s[T_NOW]
    return what


def _compare(s):
    # Updates the extremes of the brightness, the first reading at the present position, and the
    # last two readings.
    x_um = s[X_NOW_UM]
    b = s[B_NOW]
    if b >= s[PEAK]:
        s[PEAK] = s[LOW] = b
        s[X_PEAK_UM] = x_um
    if b < s[LOW]:
        s[LOW] = b
    if b < s[LEAST]:
        s[LEAST] = b
    s[X_LAST_UM] = x_last_um = s[X_SEEN_UM]
    s[B_LAST] = b_last = s[B_SEEN]
    s[X_SEEN_UM] = x_um
    s[B_SEEN] = b
    off_um = abs(x_um - x_last_um)
    steady = off_um < REST_UM or off_um < noise(s[NOISE_PRODUCT], min(b, b_last)) * 7 >> 1
    if b > b_last + RISEN:
        s[B_BOTH] = 0
    elif s[RESTED] and not steady:
        s[X_BOTH_UM] = x_last_um
        s[B_BOTH] = b_last
        s[FIT_BOTH] = s[FIT_SEEN]
    s[RESTED] = steady
    s[FIT_SEEN] = s[FITS]
    if s[FITS] and steady and s[SEEN] >= 0:
        s[SEEN] = min(s[SEEN] + 1, 99)
    else:
        s[SEEN] = 0 if s[FITS] else -1
        s[SINCE] = s[T_NOW]
        s[B_SINCE] = b
    s[STEP_LAST_UM] = s[STEP_UM]
    s[STEP_UM] = abs(x_um - s[X_UM]) - abs(x_last_um - s[X_UM])


def _resolve(s):
    # Updates the light of two known fingers; returns -1 if neither has left, and no other finger
    # touches, but their light is not known either.
    if s[IS_EVEN]:
        if estimate(s, s[X_UM], s[B], s[FITS]):
            near = abs(s[FOUND_UM] - s[X_SECOND_UM]) < NEAR_UM
            if near and s[B_NOW] == s[PEAK]:
                s[X_SECOND_UM] = s[FOUND_UM]
                s[B_SECOND] = s[FOUND_B]
            # If `slides` returns true, its last estimate is the same.
            if near or slides(s):
                s[X_PAIR_UM] = s[X_NOW_UM]
                s[B_PAIR] = s[B_NOW]
                s[GUESSED] = False
                return MOVED
        # Two fingers that rest act like one finger at the position that was measured for both.
        slack_um = _find_third(s, s[X_PAIR_UM], s[B_PAIR], -1)
        return SAME | slack_um << 8 if slack_um else 0
    if s[FITS] and abs(s[X_NOW_UM] - s[X_SECOND_UM]) < NEAR_UM and s[B_NOW] < s[B_SECOND] + MORE:
        return LIFTED
    if not s[FALLS]:
        s[GUESSED] = False
        return -1
    slack_um = _find_third(s, s[X_SECOND_UM], s[B_SECOND], s[FITS])
    if not slack_um and (s[T_NOW] - s[FELL]) & (TICKS - 1) < _FALL_T:
        return -1
    return FADED | slack_um << 8


def _find_third(s, x0_um, b0, fits):
    # Estimates a third finger beside the position `x0_um` with the brightness `b0`. `x0_um` is the
    # position of the second finger if the first one has left; else the position that was measured
    # for both fingers. `fits` is as in `locate.locate`. Returns the uncertainty of the third
    # finger's position in um, or 0 until two readings agree on this position. While the first
    # finger lifts, readings do not agree.
    is_there = estimate(s, x0_um, b0, fits)
    agrees = s[GUESSED]
    at_um = s[FOUND_UM]
    off_um = abs(at_um - s[X_GUESS_UM])
    s[X_GUESS_UM] = at_um
    s[B_GUESS] = s[FOUND_B]
    s[GUESSED] = (
        is_there and abs(at_um - s[X_UM]) > APART_UM and abs(at_um - s[X_SECOND_UM]) > APART_UM
    )
    if not (agrees and s[GUESSED]) or off_um > APART_UM:
        return 0
    return (s[FOUND_SLACK_UM] * SOON >> 3) + off_um
