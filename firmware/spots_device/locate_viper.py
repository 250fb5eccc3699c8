"""Solves for the position of the second of two fingers, in machine code.

Replaces locate.py on boards with ``viper = true`` in board.toml.

The code is correct with words of 32 bits and of 64 bits, see kernel_viper.py. It checks no
argument.
"""

import micropython

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
def solve(found: ptr32, decay: int, off_um: int, alone: int, brightness: int) -> bool:
    # found: 0 away_um, 1 lost, 2 ratio, 3 other, as named in locate.py. 18: FAR_LOG2.
    away_um = off_um
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
        if (step_um + 64) >> 7 == 0:
            break
    return True
