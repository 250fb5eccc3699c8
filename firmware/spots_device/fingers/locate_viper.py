"""Estimates the second of two fingers in one reading, in machine code.

Replaces locate.py on boards with ``viper = true`` in board.toml.

The code is correct with words of 32 bits and of 64 bits, see kernel_viper.py. It checks no
argument.
"""

import micropython

from ..reading.log2 import GUARD, TABLE, Q
from . import state as c

_SIGN = 1 << 31


@micropython.viper
def power(exponent: int) -> int:
    part = exponent >> 10 & 1023
    value = 1024 + ((part * (672 + ((352 * part) >> 10))) >> 10)
    whole = exponent >> 20
    if whole >= 0:
        return value << whole
    return value >> (0 - whole)


@micropython.viper
def noise(product: int, brightness: int) -> int:
    sigma_um = product * 16 // ((int(power(brightness)) >> 6) + 1)
    if sigma_um > c.NOISE_MAX_UM:
        return c.NOISE_MAX_UM
    return sigma_um


@micropython.viper
def estimate(state: ptr32, at_um: int, first: int, fits: int) -> int:
    # at_um: position of the first finger; then the distance of the second finger
    # from it; at last the position of the second finger. first: brightness of the first finger;
    # then its light. As in locate.solve and locate.locate. The first three locals are in registers.
    sign = 1
    sign <<= 31
    decay = state[c.DECAY]
    x_um = (state[c.X_NOW_UM] ^ _SIGN) - _SIGN
    off_um = x_um - at_um
    brightness = (state[c.B_NOW] ^ _SIGN) - _SIGN
    first = int(power(first)) >> 6
    at_um = off_um
    # A condition is often the sign bit of differences, because a comparison takes more flash.
    shift = (0 - (first >> 19)) >> 31 & 4
    share = 0
    lost = 0
    ratio = 0
    other = 0
    for _ in range(4):
        if (at_um + (1 << c.FAR_LOG2)) >> (c.FAR_LOG2 + 1):
            return 0
        exponent = (at_um * decay) >> 4
        bend = exponent >> 10
        lost = ((((bend * bend) >> 8) * ((share * (256 - share)) >> 8)) >> 8) * 69
        if lost > 1 << 20:
            lost = 1 << 20
        # power(brightness + lost) and power(exponent), without calls.
        power_of = brightness + lost
        other = 0
        for _ in range(2):
            ratio = other
            other = power_of >> 10 & 1023
            other = 1024 + ((other * (672 + ((352 * other) >> 10))) >> 10)
            power_of >>= 20
            if power_of >= 0:
                other <<= power_of
            else:
                other >>= 0 - power_of
            power_of = exponent
        ratio = (ratio >> 6) - first
        if ((ratio - 1 - (first >> 3)) | ((3 << 20) - 1 - exponent)) & sign:
            return 0
        bend = ratio
        ratio = (other * (((first >> shift) << 10) // (ratio >> shift))) >> 10
        other = bend
        if ratio >> 13:
            return 0
        share = 262144 // (1024 + ratio)
        bend = ((off_um >> 2) * ratio) >> 8
        exponent = 1024 - (((bend >> 8) * (decay * 45)) >> 12)
        if exponent < 256:
            exponent = 256
        bend = ((((off_um + bend - at_um) >> 2) << 10) // exponent) << 2
        at_um += bend
        if (bend + 64) >> 7 == 0:
            break
    off_um = x_um - off_um
    bend = (at_um ^ (at_um >> 31)) - (at_um >> 31)
    x_um = state[c.LENGTH_UM]
    # LOSS_MISFIT <= lost, or lost <= LOSS_FIT if the reading fits.
    if (
        (bend - c.APART_UM)
        | (((1 << c.FAR_LOG2) - 1) - bend)
        | (x_um - 1)
        | (
            (lost - c.LOSS_MISFIT + fits * ((c.LOSS_MISFIT + c.LOSS_FIT) - lost * 2))
            & (0 - 1 - fits)
            & (state[c.DRIFTS] - 1)
        )
    ) & sign:
        return 0
    ratio += 1024
    share = (int(noise(state[c.NOISE_PRODUCT], brightness)) * ratio) >> 10
    share += ((bend >> 5) * (((256 - 262144 // ratio) * (first + other)) // other)) // 540
    at_um += off_um
    state[c.FOUND_UM] = at_um
    state[c.FOUND_SLACK_UM] = share
    # As in log2.log2_q20; 19: without the four bits of `other` after the point.
    exponent = 19
    while other < 1 << 23:
        other <<= 1
        exponent -= 1
    table = ptr32(TABLE)
    bend = other >> 14 & 511
    lost = table[bend]
    lost += ((other & 16383) * (table[bend + 1] - lost)) >> 14
    state[c.FOUND_B] = (exponent << Q) + ((lost + 8) >> GUARD)
    share += c.NEAR_UM
    return ((0 - at_um - share) & (at_um - x_um - share)) >> 31 & 1


@micropython.viper
def light(s: ptr32, away_um: int, is_now: int) -> int:
    # The last reading is at `LATE`, the present one two elements later.
    late = ptr32(uint(s) + 4 * c.LATE)
    two_to = power
    found = 0
    far = late[c.DECAY - c.LATE] * away_um
    bend = far >> 14
    bend = (bend * bend) >> 8
    far >>= 4
    if far > 3 << 20:
        far = 3 << 20
    if far < -9 << 20:
        far = -9 << 20
    far = int(two_to(far))
    at = is_now * (c.X_NOW_UM - c.LATE)
    while at <= c.X_NOW_UM - c.LATE:
        share = ((((late[at] ^ _SIGN) - _SIGN) - ((s[c.X_UM] ^ _SIGN) - _SIGN)) << 10) // away_um
        remainder = 1024 - share
        lost = (((share * remainder >> 12) * bend) >> 8) * 69
        if lost > 1 << 20:
            lost = 1 << 20
        lost += (late[at + 1] ^ _SIGN) - _SIGN
        found = (int(two_to(lost)) & -64) // ((1024 + far * share // remainder) >> 4) - found
        at += c.X_NOW_UM - c.LATE
    return found
