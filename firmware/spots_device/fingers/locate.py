"""Estimates the second of two fingers in one reading, see second.py.

Boards with ``viper = true`` in board.toml get locate_viper.py instead of this file: `power`,
`noise`, `estimate` and `light` with identical results, in machine code. All integers fit 31 bits;
allocates nothing.
"""

from array import array

from ..reading.log2 import log2_q20
from . import state as c

_solved = array("i", bytes(16))
_AWAY_UM, _LOST, _RATIO, _OTHER = range(4)  # its indices, see `solve`


def power(exponent):
    """Return 2**exponent in Q10, within 0.4 %; `exponent` is in Q20 and less than 19.0."""
    part = exponent >> 10 & 1023
    value = 1024 + (part * (672 + (352 * part >> 10)) >> 10)
    whole = exponent >> 20
    return value << whole if whole >= 0 else value >> -whole


def solve(found, decay, off_um, alone, brightness):
    """Solve the equations of second.py; return whether they have a solution.

    `found` gets four integers: distance d of the second finger from the first one in um, loss of
    brightness (Q20 of log2), (1 - f) / f (Q10), and light l2 in sixteenths of a count. `alone` is
    the light l1 of the first finger in this unit; `decay` and `brightness` are as in `locate`.
    """
    away_um = off_um
    shift = alone >> 19 and 4
    share = 0
    for _ in range(4):
        if away_um + (1 << c.FAR_LOG2) >> c.FAR_LOG2 + 1:
            return False
        exponent = decay * away_um >> 4
        bend = exponent >> 10
        lost = min(((bend * bend >> 8) * (share * (256 - share) >> 8) >> 8) * 69, 1 << 20)
        light = power(brightness + lost) >> 6
        other = light - alone
        if other <= alone >> 3 or exponent >= 3 << 20:
            return False
        ratio = power(exponent) * ((alone >> shift << 10) // (other >> shift)) >> 10
        if ratio >> 13:
            return False
        share = 262144 // (1024 + ratio)  # Q8
        # Newton's step for away = off * (1 + ratio(away)).
        change = (off_um >> 2) * ratio >> 8
        slope = max(1024 - ((change >> 8) * (decay * 45) >> 12), 256)
        step_um = (off_um + change - away_um >> 2 << 10) // slope << 2
        away_um += step_um
        if not step_um + 64 >> 7:
            break
    found[_AWAY_UM] = away_um
    found[_LOST] = lost
    found[_RATIO] = ratio
    found[_OTHER] = other
    return True


def noise(product, brightness):
    """Return a position's standard deviation in um, at most `state.NOISE_MAX_UM`.

    `product` is that of counts and standard deviation in um, a constant of the strip.
    """
    return min(product * 16 // ((power(brightness) >> 6) + 1), c.NOISE_MAX_UM)


def locate(found, decay, x1_um, first, x_um, brightness, fits, noise_um):
    """Estimate the second finger in a reading; return whether there is a second finger.

    `found` gets position, its uncertainty and brightness from the index `state.FOUND_UM` on.
    `decay` is that of the light by the dye (k in second.py) in log2 units per um, times 2**24, at
    most 1000. `first` and `brightness` are brightnesses in Q20 of log2: of the first finger, which
    is at `x1_um`, and of the reading. `fits` is 1 if the spectrum of the reading fits one press, 0
    if not, -1 if this is unknown: that of two fingers fits only if they are near each other.
    `noise_um` is the standard deviation of the reading's position.
    """
    alone = power(first) >> 6
    if not solve(_solved, decay, x_um - x1_um, alone, brightness):
        return False
    away_um = _solved[_AWAY_UM]  # to unpack an array allocates an iterator
    lost = _solved[_LOST]
    ratio = _solved[_RATIO]
    other = _solved[_OTHER]
    lever = (256 - 262144 // (1024 + ratio)) * (alone + other) // other  # (1 - f) l / l2, Q8
    apart_um = abs(away_um)
    room = 0
    if fits >= 0:
        room = c.LOSS_FIT - lost if fits else lost - c.LOSS_MISFIT
    if apart_um < c.APART_UM or apart_um >> c.FAR_LOG2 or room < 0:
        return False
    found[c.FOUND_UM] = x1_um + away_um
    found[c.FOUND_SLACK_UM] = (noise_um * (1024 + ratio) >> 10) + (apart_um >> 5) * lever // 540
    found[c.FOUND_B] = log2_q20(other) - (4 << 20)
    return True


def estimate(s, x1_um, b1, fits):
    """Estimate a finger beside another one, which has position `x1_um` and brightness `b1`.

    `s` is the state of a `tracker.ContactTracker` with the present reading; `fits` is as in
    `locate`. Stores the result in three elements of the state, from `FOUND_UM` on. Returns whether
    there is a solution on the strip.
    """
    return (
        s[c.LENGTH_UM]
        and locate(
            s,
            s[c.DECAY],
            x1_um,
            b1,
            s[c.X_NOW_UM],
            s[c.B_NOW],
            -1 if s[c.DRIFTS] else fits,
            noise(s[c.NOISE_PRODUCT], s[c.B_NOW]),
        )
        and -c.NEAR_UM - s[c.FOUND_SLACK_UM]
        < s[c.FOUND_UM]
        < s[c.LENGTH_UM] + c.NEAR_UM + s[c.FOUND_SLACK_UM]
    )


def _first_light(decay, off_um, brightness, away_um):
    """Return the light of the first of two fingers in a reading, in sixteenths of a count.

    `decay` is as in `locate.locate`; `brightness` is that of the reading, in Q20 of log2.

    `off_um` is the distance from the first finger to the position of the reading, `away_um` the
    distance from the first finger to the second finger.
    """
    # At most 11 words in the call frame, see strip.py. `second.weigh` makes 20 calls, and on a
    # board a call of `min` or `max` takes a tenth of the time of this function.
    share = (off_um << 10) // away_um
    decay *= away_um
    lost = decay >> 14
    lost = ((share * (1024 - share) >> 12) * (lost * lost >> 8) >> 8) * 69
    brightness += lost if lost < 1 << 20 else 1 << 20
    decay >>= 4
    if decay > 3 << 20:
        decay = 3 << 20
    elif decay < -(9 << 20):
        decay = -(9 << 20)
    ratio = power(decay) * share // (1024 - share)
    return (power(brightness) & ~63) // (1024 + ratio >> 4)


def light(s, away_um, is_now):
    """Return the light of the first of two fingers, in sixteenths of a count.

    `away_um`, not 0, is the distance of the second one. If `is_now` is false: the difference
    between this light and that in the reading before.
    """
    now = _first_light(s[c.DECAY], s[c.X_NOW_UM] - s[c.X_UM], s[c.B_NOW], away_um)
    if is_now:
        return now
    return now - _first_light(s[c.DECAY], s[c.X_LAST_UM] - s[c.X_UM], s[c.B_LAST], away_um)
