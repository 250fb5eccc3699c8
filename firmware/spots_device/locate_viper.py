"""Estimates the second of two fingers in machine code; replaces locate.py on some boards.

Correct with words of 32 bits and of 64 bits, see kernel_viper.py. No argument is checked.
"""

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


@micropython.viper
def noise(product: int, brightness: int) -> int:
    value = product * 16 // ((int(power(brightness)) >> 6) + 1)
    return 20_000 if value > 20_000 else value


@micropython.viper
def locate(
    found: ptr32,
    decay: int,
    x1_um: int,
    first: int,
    x_um: int,
    brightness: int,
    fits: int,
    noise_um: int,
) -> bool:
    off_um = away_um = x_um - x1_um
    alone = int(power(first)) >> 6
    shift = 0
    if alone >> 19:
        shift = 4
    light = lost = other = ratio = share = 0
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
        if (step_um + 64) >> 7 == 0:
            break
    apart_um = away_um
    if away_um < 0:
        apart_um = 0 - away_um
    room = 0
    if fits >= 0:
        room = 45_000 - lost if fits else lost - 12_000
    if apart_um < 4500 or apart_um >> 18 or room < 0:
        return False
    lever = (256 - share) * light // other
    found[0] = x1_um + away_um
    found[1] = ((noise_um * (1024 + ratio)) >> 10) + (apart_um >> 5) * lever // 540
    found[2] = int(log2_q20(other)) - (4 << 20)
    return True
