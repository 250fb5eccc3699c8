"""Estimates the position of the second of two fingers, while the first one rests.

The light of both fingers, l = l1 + l2, appears to come from a position between them. Let d be the
distance between the fingers. The position is then f d from the first finger, and the brightness is
slightly less than ln(l):

    f / (1 - f) = l2 / l1 * exp(-k d)        ln(l) - brightness = 0.39 f (1 - f) (k d)**2

k is the decay at wavelengths that the dye absorbs. Both equations hold within 0.01 on strips of 30
to 85 mm. Two measured values give the two unknowns l2 and d. No value remains to check that the
first finger rests, so several readings must agree. Integers of 31 bits only; allocates nothing.
"""

try:
    from micropython import const
except ImportError:
    const = int  # on the host

from .log2 import log2_q20

_NEAR_UM = const(4500)
_FAR_UM = const(250_000)
# The misfit grows with the loss of brightness (Q20 of log2). The loss of a reading that fits one
# press is below the first limit, that of another reading above the second one.
_FIT = const(45_000)
_MISFIT = const(12_000)


def power(exponent):
    """Return 2**exponent in Q10, within 0.4 %; `exponent` is in Q20 and below 19."""
    part = exponent >> 10 & 1023
    value = 1024 + (part * (672 + (352 * part >> 10)) >> 10)
    whole = exponent >> 20
    return value << whole if whole >= 0 else value >> -whole


def locate(found, decay, x1_um, first, x_um, brightness, fits, noise_um):
    """Estimate the second finger in a reading; return whether there is one.

    Parameters
    ----------
    found : sequence of int
        Output: position of the second finger in um, its uncertainty in um, and its brightness in
        Q20 of log2.
    decay : int
        k in log2 units per micrometre, Q24; at most 1000.
    x1_um, first : int
        Position of the first finger in um, and its brightness in Q20 of log2.
    x_um, brightness : int
        Position of the reading in um, and its brightness in Q20 of log2.
    fits : bool
        Whether the spectrum of the reading fits one press. That of two fingers fits if they are
        near each other, and does not if they are far from each other.
    noise_um : int
        Standard deviation of the reading's position, in um.
    """
    off_um = x_um - x1_um
    if not -_FAR_UM < off_um < _FAR_UM:
        return False
    alone = power(first) >> 6  # sixteenths of a count
    lost = 0
    away_um = off_um
    for _ in range(4):
        light = power(brightness + lost) >> 6
        other = light - alone
        if other < alone >> 3:
            return False
        second = log2_q20(other) - (4 << 20)
        exponent = first - second + (decay * away_um >> 4)
        if not -(9 << 20) < exponent < 3 << 20:
            return False
        ratio = power(exponent)
        share = 262144 // (1024 + ratio)  # Q8
        # Newton's step for away = off * (1 + ratio(away)).
        change = (off_um >> 2) * ratio >> 8
        slope = max(1024 - ((change >> 8) * (decay * 45) >> 12), 256)
        step_um = (off_um + change - away_um >> 2 << 10) // slope << 2
        away_um += step_um
        if not -_FAR_UM < away_um < _FAR_UM:
            return False
        bend = decay * away_um >> 14
        lost = min(((bend * bend >> 8) * (share * (256 - share) >> 8) >> 8) * 69, 1 << 20)
        if -64 < step_um < 64:
            break
    if abs(away_um) < _NEAR_UM or (lost > _FIT if fits else lost < _MISFIT):
        return False
    lever = (256 - share) * light // other
    found[0] = x1_um + away_um
    found[1] = (noise_um * (1024 + ratio) >> 10) + (abs(away_um) >> 5) * lever // 540
    found[2] = second
    return True
