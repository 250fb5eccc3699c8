"""Estimates the second of two fingers from two readings, with the arithmetic in machine code.

Replaces second.py on boards with ``viper = true`` in board.toml.

The code is correct with words of 32 bits and of 64 bits, see kernel_viper.py. It checks no
argument.
"""

import micropython

from .contact_state import (
    APART_UM,
    EVEN,
    FOUND_B,
    FOUND_SLACK_UM,
    FOUND_UM,
    LENGTH_UM,
    NEAR_UM,
    X_LAST_UM,
    X_NOW_UM,
    X_UM,
    B,
)
from .locate import FAR_LOG2, power
from .log2 import log2_q20

_ROOM_UM = 300
_STEP_UM = 2000


@micropython.viper
def _light(s: ptr32, away_um: int, at: int) -> int:
    # Returns the light of the first finger in the present reading, in counts times 16, if the
    # distance of the second finger is `away_um`; `at` is 18. With `at` = 0, returns instead by how
    # much this light exceeds that in the reading before. As in `second._part`.
    # s: 4 X_UM. late, the elements from 43 on: 0 X_LAST_UM, 1 B_LAST, 18 X_NOW_UM,
    # 19 B_NOW, 28 DECAY.
    late = ptr32(uint(s) + 172)
    sign = 1
    sign <<= 31
    two_to = power
    light = 0
    far = late[28] * away_um
    bend = far >> 14
    bend = (bend * bend) >> 8
    far >>= 4
    if far > 3 << 20:
        far = 3 << 20
    if far < -9 << 20:
        far = -9 << 20
    far = int(two_to(far))
    while at < 19:
        share = ((((late[at] ^ sign) - sign) - ((s[4] ^ sign) - sign)) << 10) // away_um
        rest = 1024 - share
        lost = (((share * rest >> 12) * bend) >> 8) * 69
        if lost > 1 << 20:
            lost = 1 << 20
        lost += (late[at + 1] ^ sign) - sign
        light = (int(two_to(lost)) & -64) // ((1024 + far * share // rest) >> 4) - light
        at += 18
    return light


def _far_um(s):
    end_um = s[LENGTH_UM] + NEAR_UM if s[X_NOW_UM] > s[X_UM] else -NEAR_UM
    return end_um - s[X_UM]


def may_rest(s):
    off_um = s[X_NOW_UM] - s[X_UM]
    far_um = _far_um(s)
    sign = 1 if far_um > 0 else -1
    far_um = min(far_um * sign, 1 << FAR_LOG2)
    return off_um * sign < _ROOM_UM or (
        off_um * sign < far_um - _ROOM_UM
        and _light(s, far_um * sign, 18) >= power(s[B] - EVEN) >> 6
    )


def weigh(s):
    a_um = s[X_LAST_UM] - s[X_UM]
    b_um = s[X_NOW_UM] - s[X_UM]
    far_um = _far_um(s)
    sign = 1 if far_um > 0 else -1
    low = max(a_um * sign, b_um * sign) + _ROOM_UM
    high = far_um * sign
    if min(a_um * sign, b_um * sign) < _ROOM_UM or not low < high < (1 << FAR_LOG2):
        return False
    low *= sign
    high *= sign
    above = _light(s, low, 0) < 0
    if above == (_light(s, high, 0) < 0):
        return False
    for _ in range(8):
        middle = low + high >> 1
        if above == (_light(s, middle, 0) < 0):
            low = middle
        else:
            high = middle
    light = _light(s, low, 18)
    if light < 16 or abs(low) < APART_UM:
        return False
    gap = _light(s, low + sign * _STEP_UM, 0)
    s[FOUND_UM] = s[X_UM] + low
    s[FOUND_SLACK_UM] = min(light * (_STEP_UM // 80) // (abs(gap) + 1), 1 << FAR_LOG2)
    s[FOUND_B] = log2_q20(light) - (4 << 20)
    return True
