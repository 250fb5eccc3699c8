"""Processes a reading while there may be two fingers, in machine code.

Replaces pair.py on boards with ``viper = true`` in board.toml.

The code is correct with words of 32 bits and of 64 bits, see kernel_viper.py. It checks no
argument.
"""

import micropython

from .evidence import guess, has_almost_left, remains, slides
from .locate import estimate, noise


@micropython.viper
def watch(s: ptr32, late: ptr32, b: int, state) -> int:
    # s: 0 FOUND_UM, 1 FOUND_SLACK_UM, 2 FOUND_B, 4 X_UM, 5 KNOWN, 6 SEEN, 7 X_SEEN_UM, 8 B_SEEN,
    # 9 STEP_UM, 10 B, 12 GUESSED, 13 SINCE, 14 B_SINCE, 15 T, 16 IS_EVEN, 17 RISES, 18 FALLS,
    # 19 FELL, 20 SECOND, 21 THIRD, 22 PAIR, 24 PEAK, 25 LOW, 26 LEAST, 27 RESTED, 28 FIT_SEEN,
    # 29 HAS_DIPPED, 31 LENGTH_UM, 34 FLAGS_NOW, 35 B_BOTH, 36 FIT_BOTH, 37 X_BOTH_UM.
    # late, the elements from 38 on: 0 X_PEAK_UM, 2 FORCE_MN, 3 X_PAIR_UM, 4 B_PAIR, 5 X_LAST_UM,
    # 6 B_LAST, 7 STEP_LAST_UM, 8 X_GUESS_UM, 9 B_GUESS, 15 STUCK_T, 16 RELEASE_MN,
    # 18 NOISE_PRODUCT, 19 ODD, 21 HINT_UM, 22 LEAVING, 23 X_NOW_UM, 25 T_NOW, 26 FORCE_NOW_MN,
    # 27 FITS, 30 X_SECOND_UM, 31 B_SECOND.
    # Flags: 1 TOUCHING, 4 TOO_DARK, 16 MISFIT, 67: also NOT_CALIBRATED and SATURATED, 256 CHECKED.
    # 0x3FFFFF: TICKS - 1. Results: 16 MOVED, 17 NEXT, 18 LIFTED, 19 SAME, 20 FADED, or the sum of
    # 1 SINGLE, 2 ENDS, 4 REMAINS, 8 FOUND.
    # Each `if`, `and` and `or` takes 12 bytes of flash, and each comparison 20. So a condition is
    # often the sign bit of differences. The first three locals are in registers.
    late = ptr32(uint(late) + 152)
    sign = 1
    sign <<= 31
    mask = 0x3FFFFF
    flags = s[34]
    fits = late[27]
    if flags < 256:
        if (
            (0 - ((flags & 67 ^ 1) | late[15]))
            | (s[31] - 1)
            | ((late[26] - late[16]) & ((flags & 20) - 1))
        ) & sign:
            return -1
        s[29] = s[29] | late[22]
        late[22] = 0
        fits = ((flags >> 4) & ((flags >> 2) ^ 1) & 1) ^ 1
        late[27] = fits
        if fits:
            late[2] = late[26]
    b_last = (s[8] ^ sign) - sign
    risen = b - b_last
    falls = s[18]
    now = late[25]
    # 30000: RISEN. 9: LIFTS_T.
    grows = 30000 - risen
    if grows & (8 - (s[15] - s[19] & mask)) & sign and has_almost_left(state):
        return 17

    # 337000: LOST. 116000: _GROWN. 397000: _BOTH.
    peak = (s[24] ^ sign) - sign
    low = (s[25] ^ sign) - sign
    first = (s[10] ^ sign) - sign
    x_um = (late[23] ^ sign) - sign
    if (low + 337000 - peak) & (low + 116000 - b) & (first + 397000 - peak) & sign:
        s[21] = 1
    if b >= peak:
        peak = b
        low = b
        s[24] = b
        late[0] = x_um
    if b < low:
        low = b
    s[25] = low
    if (b - s[26]) & sign:
        s[26] = b
    x1_um = (s[4] ^ sign) - sign
    away_um = x_um - x1_um
    away_um = (away_um ^ (away_um >> 31)) - (away_um >> 31)
    off_um = (s[7] ^ sign) - sign
    late[5] = off_um
    late[6] = b_last
    s[7] = x_um
    s[8] = b
    step_um = off_um - x1_um
    step_um = away_um - ((step_um ^ (step_um >> 31)) - (step_um >> 31))
    late[7] = s[9]
    s[9] = step_um
    off_um = x_um - off_um
    off_um = (off_um ^ (off_um >> 31)) - (off_um >> 31)
    steady = 1
    # 250: REST_UM.
    if off_um >= 250:
        if b < b_last:
            b_last = b
        steady = (off_um - ((int(noise(late[18], b_last)) * 7) >> 1)) >> 31 & 1
    if grows < 0:
        s[35] = 0
    elif s[27] > steady:
        s[37] = late[5]
        s[35] = late[6]
        s[36] = s[28]
    s[27] = steady
    s[28] = fits
    seen = (s[6] ^ sign) - sign
    if (0 - (fits & steady)) & (0 - 1 - seen) & sign:
        seen += (seen - 99) >> 31 & 1
    else:
        seen = fits - 1
        s[13] = now
        s[14] = b
    s[6] = seen
    late[19] = late[19] | (fits ^ 1)

    # 150000: _CHANGED. 20000: _FAST_UM. 1999: NEAR_UM - 1. 74000: EVEN. 40000: CALM.
    second = s[20]
    what = 0
    peak -= 74000
    dims = b - peak
    off_um = x_um - late[21]
    if (
        fits & s[5] & s[22] & (second ^ 1)
        and (
            (150000 - risen)
            | (150000 + risen)
            | ((0 - falls) & (0 - step_um) & (step_um - 20000))
            | (dims & (0 - 1 - ((off_um + 1999) | (1999 - off_um))))
        )
        & sign
    ):
        what = int(remains(state))
    if dims < 0:
        if ((0 - (second & (falls ^ 1))) & (0 - 74000 - risen)) & sign and slides(state):
            dims = 0
        if dims:
            s[16] = 0
            s[17] = 0
            if (falls - s[5]) & (risen + 40000) & (250 - step_um) & sign:
                falls = 1
                s[18] = 1
                s[19] = now

    even = s[16]
    if second:
        # 1999: NEAR_UM - 1.
        x0_um = (late[30] ^ sign) - sign
        b0 = (late[31] ^ sign) - sign
        off_um = x_um - x0_um
        if even == 0:
            if ((off_um + 1999) | (1999 - off_um) | (b0 + 170999 - b) | (fits - 1)) & sign == 0:
                s[15] = now
                return 18
        else:
            if estimate(state, x1_um, first, fits):
                off_um = ((s[0] ^ sign) - sign) - x0_um
                is_near = ((off_um + 1999) | (1999 - off_um)) & sign == 0
                if is_near and (s[24] ^ sign) - sign == b:
                    late[30] = s[0]
                    late[31] = s[2]
                if is_near or slides(state):
                    late[3] = x_um
                    late[4] = b
                    s[12] = 0
                    s[15] = now
                    return 16
            x0_um = (late[3] ^ sign) - sign
            b0 = (late[4] ^ sign) - sign
            fits = -1
        if even | falls:
            is_there = 0
            if estimate(state, x0_um, b0, fits):
                is_there = 1
            at_um = (s[0] ^ sign) - sign
            off_um = at_um - ((late[8] ^ sign) - sign)
            late[8] = at_um
            late[9] = s[2]
            # 4500: APART_UM.
            away_um = at_um - x1_um
            step_um = at_um - late[30]
            is_there = (
                is_there
                & (((away_um + 4500) | (4500 - away_um)) >> 31)
                & (((step_um + 4500) | (4500 - step_um)) >> 31)
            )
            off_um = (off_um ^ (off_um >> 31)) - (off_um >> 31)
            if s[12] & is_there & (((off_um - 4501) & sign) >> 31):
                off_um += (s[1] * 5) >> 3
            else:
                off_um = 0
            s[12] = is_there
            # 34: _FALL_T.
            if (0 - (even | off_um) | 33 - (now - s[19] & mask)) & sign:
                s[15] = now
                if off_um | (even ^ 1):
                    off_um = (off_um << 8) + 20 - even
                return off_um
        else:
            s[12] = 0
    else:
        late[3] = x_um
        late[4] = b
        if (even | (s[17] & s[22]) | s[12]) > (s[21] | s[29]) and guess(state):
            what |= 8
    s[22] = 1
    # 12: _REST_T.
    if what & 3 or (0 - seen) & (12 * seen - 1 - (now - s[13] & mask) * (seen + 1)) & sign:
        what |= 4
    s[15] = now
    return what
