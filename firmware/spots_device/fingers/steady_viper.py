"""Processes a reading of a finger that rests or moves slowly, in machine code.

Replaces steady.py on boards with ``viper = true`` in board.toml.

The code is correct with words of 32 bits and of 64 bits, see kernel_viper.py. It checks no
argument.
"""

import micropython


@micropython.viper
def stays(s: ptr32, flags: int) -> bool:
    # s: 4 X_UM, 7 X_SEEN_UM, 10 B, 11 B_BEFORE, 15 T, 23 LOOSE, 29 HAS_DIPPED, 30 DRIFTS,
    # 32 B_OLDEST. late, the elements from 35 on: 4 X_BEFORE_UM, 5 FORCE_MN, 13 STILL, 14 LOW_UM,
    # 15 HIGH_UM, 16 LOW_MN, 17 HIGH_MN, 18 STUCK_T, 19 RELEASE_MN, 25 LEAVING, 26 X_NOW_UM,
    # 27 B_NOW, 28 T_NOW, 29 FORCE_NOW_MN, 31 FIRM_MN.
    # flags: 1 TOUCHING, 4 TOO_DARK, 16 MISFIT; 195: also LED_OFF, NOT_CALIBRATED, SATURATED.
    # 449: SAME_UM - 1, 0x3FFFFF: TICKS - 1.
    late = ptr32(uint(s) + 140)  # third of the locals, so it is in a register
    sign = 1
    sign <<= 31
    x_um = (late[26] ^ sign) - sign
    force_mN = late[29]
    off_um = x_um - ((s[4] ^ sign) - sign)
    # Each term is negative if its condition is false: one comparison takes less flash than ten.
    if (
        (0 - ((flags & 195 ^ 1) | ((flags >> 2 ^ flags) & 4) | late[25]))
        | (off_um + 449)
        | (449 - off_um)
        | (force_mN - late[19])
        | (late[31] - 1 - force_mN)
        | (
            (
                (x_um - ((late[14] ^ sign) - sign))
                | (((late[15] ^ sign) - sign) - x_um)
                | (force_mN - late[16])
                | (late[17] - force_mN)
                | (late[18] - 1 - ((late[28] - late[13]) & 0x3FFFFF))
            )
            & (0 - late[18])
        )
    ) < 0:
        return False
    late[5] = force_mN
    late[4] = s[4]
    s[4] = x_um - off_um + (off_um >> 1)
    s[7] = x_um
    s[32] = s[11]
    s[11] = s[10]
    s[10] = late[27]
    s[23] = 0
    s[29] = 0
    s[30] = flags & 16
    s[15] = late[28]
    return True
