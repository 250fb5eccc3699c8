"""Estimates the second of two fingers in one reading, in machine code.

Replaces locate.py on boards with ``viper = true`` in board.toml.

The code is correct with words of 32 bits and of 64 bits, see kernel_viper.py. It checks no
argument.
"""

import micropython

from ..reading.log2 import TABLE

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
    sigma_um = product * 16 // ((int(power(brightness)) >> 6) + 1)
    if sigma_um > 20000:
        return 20000
    return sigma_um


@micropython.viper
def estimate(state: ptr32, at_um: int, first: int, fits: int) -> int:
    # state: 0 FOUND_UM, 1 FOUND_SLACK_UM, 2 FOUND_B, 30 DRIFTS, 31 LENGTH_UM, 56 NOISE_PRODUCT,
    # 61 X_NOW_UM, 62 B_NOW, 71 DECAY. 18: FAR_LOG2. 4500: APART_UM. 45000: _FIT. 12000: _MISFIT.
    # 2000: NEAR_UM. at_um: position of the first finger; then the distance of the second finger
    # from it; at last the position of the second finger. first: brightness of the first finger;
    # then its light. As in locate.solve and locate.locate. The first three locals are in registers.
    sign = 1
    sign <<= 31
    decay = state[71]
    x_um = (state[61] ^ sign) - sign
    off_um = x_um - at_um
    brightness = (state[62] ^ sign) - sign
    first = int(power(first)) >> 6
    at_um = off_um
    # A condition is often the sign bit of differences, because a comparison takes more flash.
    shift = (0 - (first >> 19)) >> 31 & 4
    share = 0
    lost = 0
    ratio = 0
    other = 0
    for _ in range(4):
        if (at_um + (1 << 18)) >> 19:
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
    x_um = state[31]
    # 12000 <= lost, or lost <= 45000 if the reading fits. 262143: (1 << FAR_LOG2) - 1.
    if (
        (bend - 4500)
        | (262143 - bend)
        | (x_um - 1)
        | ((lost - 12000 + fits * (57000 - lost * 2)) & (0 - 1 - fits) & (state[30] - 1))
    ) & sign:
        return 0
    ratio += 1024
    share = (int(noise(state[56], brightness)) * ratio) >> 10
    share += ((bend >> 5) * (((256 - 262144 // ratio) * (first + other)) // other)) // 540
    at_um += off_um
    state[0] = at_um
    state[1] = share
    # As in log2.log2_q20; 19: without the four bits of `other` after the point.
    exponent = 19
    while other < 1 << 23:
        other <<= 1
        exponent -= 1
    table = ptr32(TABLE)
    bend = other >> 14 & 511
    lost = table[bend]
    lost += ((other & 16383) * (table[bend + 1] - lost)) >> 14
    state[2] = (exponent << 20) + ((lost + 8) >> 4)
    share += 2000
    return ((0 - at_um - share) & (at_um - x_um - share)) >> 31 & 1


@micropython.viper
def light(s: ptr32, away_um: int, is_now: int) -> int:
    # s: 4 X_UM. late, the elements from 43 on: 0 X_LAST_UM, 1 B_LAST, 18 X_NOW_UM, 19 B_NOW,
    # 28 DECAY.
    late = ptr32(uint(s) + 172)
    sign = 1
    sign <<= 31
    two_to = power
    found = 0
    far = late[28] * away_um
    bend = far >> 14
    bend = (bend * bend) >> 8
    far >>= 4
    if far > 3 << 20:
        far = 3 << 20
    if far < -9 << 20:
        far = -9 << 20
    far = int(two_to(far))
    at = is_now * 18
    while at < 19:
        share = ((((late[at] ^ sign) - sign) - ((s[4] ^ sign) - sign)) << 10) // away_um
        rest = 1024 - share
        lost = (((share * rest >> 12) * bend) >> 8) * 69
        if lost > 1 << 20:
            lost = 1 << 20
        lost += (late[at + 1] ^ sign) - sign
        found = (int(two_to(lost)) & -64) // ((1024 + far * share // rest) >> 4) - found
        at += 18
    return found
