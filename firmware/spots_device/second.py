"""Estimates the position of the second of two fingers, while the first finger rests.

The light of both fingers, l = l1 + l2, appears to come from one position between the fingers. Let d
be the distance between the fingers. This position has the distance f d from the first finger, with
0 < f < 1, and the brightness (here a natural logarithm) is slightly less than ln(l):

    f / (1 - f) = l2 / l1 * exp(-k d)        ln(l) - brightness = 0.39 f (1 - f) (k d)**2

k is the decay at wavelengths that the dye absorbs. Both equations hold within 0.01 on strips of 30
to 85 mm. A reading gives two values, position and brightness, for the two unknowns l2 and d. No
value remains to check that the first finger rests, so several readings must agree. All integers fit
31 bits; allocates nothing.
"""

from array import array

try:
    from micropython import const
except ImportError:
    const = int  # on the host

from .locate import FAR_LOG2, power, solve
from .log2 import log2_q20

_NEAR_UM = const(4500)  # least distance between two fingers
_ROOM_UM = const(300)
_STEP_UM = const(2000)
# The misfit grows with the loss of brightness (Q20 of log2) that two fingers cause. The loss is
# below `_FIT` if the reading fits one press, and above `_MISFIT` if it does not.
_FIT = const(45_000)
_MISFIT = const(12_000)

_solved = array("i", bytes(16))


def noise(product, brightness):
    """Return a position's standard deviation in um: `product` divided by the counts; at most 20000.

    Parameters
    ----------
    product : int
        Product of counts and standard deviation of the position in um; a constant of the strip.
    brightness : int
        Brightness in Q20 of log2, from which the counts are computed.
    """
    return min(product * 16 // ((power(brightness) >> 6) + 1), 20_000)


def locate(found, decay, x1_um, first, x_um, brightness, fits, noise_um):
    """Estimate the second finger in a reading; return whether there is a second finger.

    Parameters
    ----------
    found : array.array
        Output, ``array("i")``: position of the second finger in um, uncertainty of this position in
        um, and brightness of the second finger in Q20 of log2.
    decay : int
        Decay of the light by the dye (k, see the module) in log2 units per um, Q24; at most 1000.
    x1_um, first : int
        Position of the first finger in um, and its brightness in Q20 of log2.
    x_um, brightness : int
        Position of the reading in um, and its brightness in Q20 of log2.
    fits : int
        1 if the spectrum of the reading fits one press, 0 if not, -1 if this is unknown. The
        spectrum of two fingers fits one press only if the fingers are near each other.
    noise_um : int
        Standard deviation of the reading's position, in um.
    """
    alone = power(first) >> 6
    if not solve(_solved, decay, x_um - x1_um, alone, brightness):
        return False
    away_um, lost, ratio, other = _solved
    lever = (256 - 262144 // (1024 + ratio)) * (alone + other) // other  # (1 - f) l / l2, Q8
    apart_um = abs(away_um)
    room = 0
    if fits >= 0:
        room = _FIT - lost if fits else lost - _MISFIT
    if apart_um < _NEAR_UM or apart_um >> FAR_LOG2 or room < 0:
        return False
    found[0] = x1_um + away_um
    found[1] = (noise_um * (1024 + ratio) >> 10) + (apart_um >> 5) * lever // 540
    found[2] = log2_q20(other) - (4 << 20)
    return True


def _part(decay, off_um, brightness, away_um):
    """Return the light of the first of two fingers in a reading, in counts times 16.

    `decay` is as in `locate`, and `brightness` is that of the reading in Q20 of log2.

    `off_um` is the distance from the first finger to the position of the reading, `away_um` the
    distance from the first finger to the second finger.
    """
    share = (off_um << 10) // away_um
    bend = decay * away_um >> 14
    lost = min(((bend * bend >> 8) * (share * (1024 - share) >> 12) >> 8) * 69, 1 << 20)
    exponent = min(max(decay * away_um >> 4, -(9 << 20)), 3 << 20)
    ratio = power(exponent) * share // (1024 - share)
    return (power(brightness + lost) & ~63) // (1024 + ratio >> 4)


def may_rest(decay, x1_um, first, end_um, x_um, brightness):
    """Return whether the first finger may still have its brightness `first` in a later reading.

    The arguments are those of `locate`. The result is False if the first finger must have become
    dimmer, even with a second finger at the strip's end `end_um`.
    """
    off_um = x_um - x1_um
    far_um = end_um - x1_um
    sign = 1 if far_um > 0 else -1
    far_um = min(far_um * sign, (1 << FAR_LOG2))
    if off_um * sign < _ROOM_UM:
        return True
    return (
        off_um * sign < far_um - _ROOM_UM
        and _part(decay, off_um, brightness, far_um * sign) >= power(first) >> 6
    )


def weigh(found, decay, x1_um, limit_um, x_um, brightness, x_next_um, next_b):
    """Estimate both fingers from two readings; only the second finger's force differs between them.

    Parameters
    ----------
    found : sequence of int
        Output: position of the second finger in um, uncertainty of this position in um, and
        brightness of the first finger in Q20 of log2.
    decay, x1_um : int
        As in `locate`.
    limit_um : int
        End of the strip, in um, on the side of the second finger.
    x_um, brightness, x_next_um, next_b : int
        Position in um and brightness in Q20 of log2, of the earlier and of the later reading.

    Returns
    -------
    bool
        Whether there is a second finger.
    """
    a_um = x_um - x1_um
    b_um = x_next_um - x1_um
    far_um = limit_um - x1_um
    sign = 1 if far_um > 0 else -1
    low = max(a_um * sign, b_um * sign) + _ROOM_UM
    high = far_um * sign
    if min(a_um * sign, b_um * sign) < _ROOM_UM or not low < high < (1 << FAR_LOG2):
        return False
    low *= sign
    high *= sign
    above = _part(decay, a_um, brightness, low) > _part(decay, b_um, next_b, low)
    if above == (_part(decay, a_um, brightness, high) > _part(decay, b_um, next_b, high)):
        return False
    for _ in range(8):
        middle = low + high >> 1
        if above == (_part(decay, a_um, brightness, middle) > _part(decay, b_um, next_b, middle)):
            low = middle
        else:
            high = middle
    light = _part(decay, b_um, next_b, low)
    if light < 16 or abs(low) < _NEAR_UM:
        return False
    farther = low + sign * _STEP_UM
    gap = _part(decay, a_um, brightness, farther) - _part(decay, b_um, next_b, farther)
    found[0] = x1_um + low
    found[1] = min(light * (_STEP_UM // 80) // (abs(gap) + 1), (1 << FAR_LOG2))
    found[2] = log2_q20(light) - (4 << 20)
    return True
