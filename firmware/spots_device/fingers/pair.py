"""Compares a reading with earlier ones while there may be two fingers; finds what has happened.

`tracker.ContactTracker` then reports it. Integers only; allocates nothing.
"""

from ..reading import decode
from . import state as c
from .evidence import guess, passes, remains, slides
from .locate import estimate, noise, power


def watch(s, b):
    """Compare the present reading, of brightness `b`, with those before; return what has happened.

    0: nothing to report; else a number or bits from state.py, such as `MOVED` or `FOUND | REMAINS`.
    -1: the reading needs the checks in `tracker.ContactTracker.take`; the state is then unchanged.
    """
    flags = s[c.FLAGS_NOW]
    if not flags & c.CHECKED:
        if (
            flags & (decode.TOUCHING | decode.NOT_CALIBRATED | decode.SATURATED) != decode.TOUCHING
            or (
                s[c.FORCE_NOW_MN] < s[c.RELEASE_MN]
                and not flags & (decode.MISFIT | decode.TOO_DARK)
            )
            or s[c.STUCK_T]
            or s[c.LEAVING]
            or not s[c.LENGTH_UM]
        ):
            return -1
        s[c.FITS] = not flags & decode.MISFIT or flags & decode.TOO_DARK > 0
        if s[c.FITS]:
            s[c.FORCE_MN] = s[c.FORCE_NOW_MN]
    what = s[c.FIT_SEEN]  # of the reading before
    _compare(s)
    if not s[c.FITS]:
        s[c.ODD] = True
    if what and s[c.KNOWN] and s[c.PAIR] and not s[c.SECOND] and passes(s):
        s[c.T] = s[c.T_NOW]
        return c.PASSED
    what = 0
    if s[c.FITS] and s[c.PAIR] and not s[c.SECOND]:
        what = remains(s)
    if b < s[c.PEAK] - c.EVEN and not (
        s[c.SECOND] and not s[c.FALLS] and b > s[c.B_LAST] - c.EVEN and slides(s)
    ):
        s[c.IS_EVEN] = s[c.RISES] = False  # the first finger may be leaving
        if s[c.KNOWN] and not s[c.FALLS] and b < s[c.B_LAST] - c.CALM and s[c.STEP_UM] > c.REST_UM:
            s[c.FALLS] = True
            s[c.FELL] = s[c.T_NOW]
    if s[c.SECOND]:
        done = _resolve(s)
        if done >= 0:
            s[c.T] = s[c.T_NOW]
            return done
    else:
        s[c.X_PAIR_UM] = s[c.X_NOW_UM]
        s[c.B_PAIR] = b
        if guess(s):
            what |= c.FOUND
    s[c.PAIR] = True
    if what & (c.SINGLE | c.ENDS) or (
        s[c.SEEN] >= 1
        and ((s[c.T_NOW] - s[c.SINCE]) & (c.TICKS - 1)) * (s[c.SEEN] + 1) >= c.REST_T * s[c.SEEN]
    ):
        what |= c.REMAINS
    s[c.T] = s[c.T_NOW]
    return what


def _compare(s):
    # Updates the extremes of the brightness, the first reading at the present position, and the
    # last two readings.
    s[c.CROSS_UM] = 0
    if s[c.KNOWN] and (s[c.CROSS_NEAR_UM] or s[c.CROSS_FAR_UM]):
        _separate(s)
    x_um = s[c.X_NOW_UM]
    b = s[c.B_NOW]
    if b >= s[c.PEAK]:
        s[c.PEAK] = b
        s[c.X_PEAK_UM] = x_um
    if b < s[c.LEAST]:
        s[c.LEAST] = b
    s[c.X_LAST_UM] = x_last_um = s[c.X_SEEN_UM]
    s[c.B_LAST] = b_last = s[c.B_SEEN]
    s[c.X_SEEN_UM] = x_um
    s[c.B_SEEN] = b
    off_um = abs(x_um - x_last_um)
    steady = off_um < c.REST_UM or off_um < noise(s[c.NOISE_PRODUCT], min(b, b_last)) * 7 >> 1
    if b > b_last + c.RISEN:
        s[c.B_BOTH] = 0
    elif s[c.WAS_STILL] and not steady:
        s[c.X_BOTH_UM] = x_last_um
        s[c.B_BOTH] = b_last
        s[c.FIT_BOTH] = s[c.FIT_SEEN]
    s[c.WAS_STILL] = steady
    s[c.FIT_SEEN] = s[c.FITS]
    if s[c.FITS] and steady and s[c.SEEN] >= 0:
        s[c.SEEN] = min(s[c.SEEN] + 1, c.SEEN_MAX)
    else:
        s[c.SEEN] = 0 if s[c.FITS] else -1
        s[c.SINCE] = s[c.T_NOW]
        s[c.B_SINCE] = b
    s[c.STEP_LAST_UM] = s[c.STEP_UM]
    s[c.STEP_UM] = abs(x_um - s[c.X_UM]) - abs(x_last_um - s[c.X_UM])


def _separate(s):
    # Corrects the position of a reading of two fingers. The board has corrected it as that of one
    # press with the light l of both fingers, but the colour of each finger depends on its own light
    # l1 or l2. The correction is linear in the light, because both depend on the contact area. So
    # the weighted mean of both corrections differs from that of l by 2 l1 l2 / l times its slope.
    first = s[c.B]
    if first >= s[c.B_NOW]:
        return
    share = power(min(first - s[c.CROSS_B], 0)) * (1024 - power(first - s[c.B_NOW])) >> 10
    slope_um = s[c.CROSS_FAR_UM] - s[c.CROSS_NEAR_UM]
    slope_um = slope_um * (s[c.X_NOW_UM] // (s[c.LENGTH_UM] + 255 >> 8)) >> 8
    s[c.CROSS_UM] = share * (s[c.CROSS_NEAR_UM] + slope_um) >> 9
    s[c.X_NOW_UM] += s[c.CROSS_UM]


def _resolve(s):
    # Updates the light of two known fingers; returns -1 if neither has left, and no other finger
    # touches, but their light is not known either.
    if s[c.IS_EVEN]:
        if estimate(s, s[c.X_UM], s[c.B], s[c.FITS]):
            near = abs(s[c.FOUND_UM] - s[c.X_SECOND_UM]) < c.NEAR_UM
            if near and s[c.B_NOW] == s[c.PEAK]:
                s[c.X_SECOND_UM] = s[c.FOUND_UM]
                s[c.B_SECOND] = s[c.FOUND_B]
            # If `slides` returns true, its last estimate is the same.
            if near or slides(s):
                s[c.X_PAIR_UM] = s[c.X_NOW_UM]
                s[c.B_PAIR] = s[c.B_NOW]
                s[c.GUESSED] = False
                return c.MOVED
        # Two fingers that rest act like one finger at the position that was measured for both.
        slack_um = _find_third(s, s[c.X_PAIR_UM], s[c.B_PAIR], -1)
        return c.SAME | slack_um << 8 if slack_um else 0
    if (
        s[c.FITS]
        and abs(s[c.X_NOW_UM] - s[c.X_SECOND_UM]) < c.NEAR_UM
        and s[c.B_NOW] < s[c.B_SECOND] + c.MORE
    ):
        return c.LIFTED
    if not s[c.FALLS]:
        s[c.GUESSED] = False
        return -1
    slack_um = _find_third(s, s[c.X_SECOND_UM], s[c.B_SECOND], s[c.FITS])
    if not slack_um and (s[c.T_NOW] - s[c.FELL]) & (c.TICKS - 1) < c.FALL_T:
        return -1
    return c.FADED | slack_um << 8


def _find_third(s, x0_um, b0, fits):
    # Estimates a third finger beside the position `x0_um` with the brightness `b0`. `x0_um` is the
    # position of the second finger if the first one has left; else the position that was measured
    # for both fingers. `fits` is as in `locate.locate`. Returns the uncertainty of the third
    # finger's position in um, or 0 until two readings agree on this position. While the first
    # finger lifts, readings do not agree.
    is_there = estimate(s, x0_um, b0, fits)
    agrees = s[c.GUESSED]
    at_um = s[c.FOUND_UM]
    off_um = abs(at_um - s[c.X_GUESS_UM])
    s[c.X_GUESS_UM] = at_um
    s[c.B_GUESS] = s[c.FOUND_B]
    s[c.GUESSED] = (
        is_there
        and abs(at_um - s[c.X_UM]) > c.APART_UM
        and abs(at_um - s[c.X_SECOND_UM]) > c.APART_UM
    )
    if not (agrees and s[c.GUESSED]) or off_um > c.APART_UM:
        return 0
    return (s[c.FOUND_SLACK_UM] * c.SOON >> 3) + off_um
