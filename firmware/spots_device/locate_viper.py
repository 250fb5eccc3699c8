"""Estimates the second of two fingers, in machine code; replaces locate.py on some boards.

The code is correct with words of 32 bits and of 64 bits, see kernel_viper.py. It checks no
argument.
"""

from array import array

import micropython

from .log2 import log2_q20

NEAR_UM = 4500
FAR_LOG2 = 18


@micropython.viper
def power(exponent: int) -> int:
    part = exponent >> 10 & 1023
    value = 1024 + ((part * (672 + ((352 * part) >> 10))) >> 10)
    whole = exponent >> 20
    if whole >= 0:
        return value << whole
    return value >> (0 - whole)


def noise(product, brightness):
    return min(product * 16 // ((power(brightness) >> 6) + 1), 20_000)


_found = array("i", bytes(20))


@micropython.viper
def _solve(found: ptr32, decay: int, off_um: int, first: int, brightness: int) -> bool:
    # found: 0 away_um, 1 lost, 2 ratio, 3 other, 4 lever, as named in `locate`. 18: FAR_LOG2.
    away_um = off_um
    alone = int(power(first)) >> 6
    shift = 0
    if alone >> 19:
        shift = 4
    share = 0
    for _ in range(4):
        if (away_um + (1 << 18)) >> 19:
            return False
        exponent = (decay * away_um) >> 4
        bend = exponent >> 10
        lost = ((((bend * bend) >> 8) * ((share * (256 - share)) >> 8)) >> 8) * 69
        if lost > 1 << 20:
            lost = 1 << 20
        light = int(power(brightness + lost)) >> 6
        other = light - alone
        if other <= alone >> 3 or exponent >= 3 << 20:
            return False
        ratio = (int(power(exponent)) * (((alone >> shift) << 10) // (other >> shift))) >> 10
        if ratio >> 13:
            return False
        share = 262144 // (1024 + ratio)
        change = ((off_um >> 2) * ratio) >> 8
        slope = 1024 - (((change >> 8) * (decay * 45)) >> 12)
        if slope < 256:
            slope = 256
        step_um = ((((off_um + change - away_um) >> 2) << 10) // slope) << 2
        away_um += step_um
        found[0] = away_um
        found[1] = lost
        found[2] = ratio
        found[3] = other
        found[4] = (256 - share) * light // other
        if (step_um + 64) >> 7 == 0:
            break
    return True


def locate(found, decay, x1_um, first, x_um, brightness, fits, noise_um):
    if not _solve(_found, decay, x_um - x1_um, first, brightness):
        return False
    away_um, lost, ratio, other, lever = _found
    apart_um = abs(away_um)
    room = 0
    if fits >= 0:
        room = 45_000 - lost if fits else lost - 12_000
    if apart_um < NEAR_UM or apart_um >> FAR_LOG2 or room < 0:
        return False
    found[0] = x1_um + away_um
    found[1] = (noise_um * (1024 + ratio) >> 10) + (apart_um >> 5) * lever // 540
    found[2] = log2_q20(other) - (4 << 20)
    return True
