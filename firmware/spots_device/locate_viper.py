"""Estimates the second of two fingers in one reading, in machine code.

Replaces locate.py on boards with ``viper = true`` in board.toml.

The code is correct with words of 32 bits and of 64 bits, see kernel_viper.py. It checks no
argument.
"""

import micropython

from .log2 import log2_q20

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


@micropython.viper
def estimate(s, x1_um: int, first: int, x_um: int, brightness: int, fits: int) -> bool:
    # s: 0 FOUND_UM, 1 FOUND_SLACK_UM, 2 FOUND_B, 30 DRIFTS, 31 LENGTH_UM, 56 NOISE_PRODUCT,
    # 70 DECAY. 18: FAR_LOG2. 4500: APART_UM. 45000: _FIT. 12000: _MISFIT. 2000: NEAR_UM.
    state = ptr32(s)
    limit_um = state[31]
    if limit_um == 0:
        return False
    decay = state[70]
    off_um = x_um - x1_um
    alone = int(power(first)) >> 6
    away_um = off_um
    # Some steps have no comparison, because a comparison takes more flash.
    shift = (0 - (alone >> 19)) >> 31 & 4
    share = 0
    lost = 0
    ratio = 0
    other = 0
    for _ in range(4):
        if (away_um + (1 << 18)) >> 19:
            return False
        exponent = (decay * away_um) >> 4
        bend = exponent >> 10
        lost = ((((bend * bend) >> 8) * ((share * (256 - share)) >> 8)) >> 8) * 69
        if lost > 1 << 20:
            lost = 1 << 20
        other = (int(power(brightness + lost)) >> 6) - alone
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
    apart_um = (away_um ^ (away_um >> 31)) - (away_um >> 31)
    if apart_um < 4500 or apart_um >> 18:
        return False
    # 12000 <= lost, or lost <= 45000 if the reading fits.
    if fits >= 0 and state[30] == 0 and lost - 12000 + fits * (57000 - 2 * lost) < 0:
        return False
    slack_um = int(noise(state[56], brightness))
    ratio += 1024
    slack_um = (slack_um * ratio) >> 10
    slack_um += ((apart_um >> 5) * (((256 - 262144 // ratio) * (alone + other)) // other)) // 540
    away_um += x1_um
    state[0] = away_um
    state[1] = slack_um
    state[2] = int(log2_q20(other)) - (4 << 20)
    slack_um += 2000
    return 0 - slack_um < away_um and away_um < limit_um + slack_um
