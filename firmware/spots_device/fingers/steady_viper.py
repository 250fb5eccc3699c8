"""Processes a reading of a finger that rests or moves slowly, in machine code.

Replaces steady.py on boards with ``viper = true`` in board.toml.

The code is correct with words of 32 bits and of 64 bits, see kernel_viper.py. It checks no
argument.
"""

import micropython

from ..reading import decode as d
from . import state as c


@micropython.viper
def stays(s: ptr32, flags: int) -> bool:
    late = ptr32(uint(s) + 4 * c.LATE)  # third of the locals, so it is in a register
    sign = 1
    sign <<= 31
    x_um = (late[c.X_NOW_UM - c.LATE] ^ sign) - sign
    force_mN = late[c.FORCE_NOW_MN - c.LATE]
    off_um = x_um - ((s[c.X_UM] ^ sign) - sign)
    # Each term is negative if its condition is false: one comparison takes less flash than ten.
    if (
        (
            0
            - (
                (flags & (d.TOUCHING | d.LED_OFF | d.NOT_CALIBRATED | d.SATURATED) ^ d.TOUCHING)
                | ((flags >> (d.MISFIT_BIT - d.TOO_DARK_BIT) ^ flags) & d.TOO_DARK)
                | late[c.LEAVING - c.LATE]
            )
        )
        | (off_um + (c.SAME_UM - 1))
        | ((c.SAME_UM - 1) - off_um)
        | (force_mN - late[c.RELEASE_MN - c.LATE])
        | (late[c.FIRM_MN - c.LATE] - 1 - force_mN)
        | (
            (
                (x_um - ((late[c.LOW_UM - c.LATE] ^ sign) - sign))
                | (((late[c.HIGH_UM - c.LATE] ^ sign) - sign) - x_um)
                | (force_mN - late[c.LOW_MN - c.LATE])
                | (late[c.HIGH_MN - c.LATE] - force_mN)
                | (
                    late[c.STUCK_T - c.LATE]
                    - 1
                    - ((late[c.T_NOW - c.LATE] - late[c.STILL - c.LATE]) & (c.TICKS - 1))
                )
            )
            & (0 - late[c.STUCK_T - c.LATE])
        )
    ) < 0:
        return False
    late[c.FORCE_MN - c.LATE] = force_mN
    late[c.X_BEFORE_UM - c.LATE] = s[c.X_UM]
    s[c.X_UM] = x_um - off_um + (off_um >> 1)
    s[c.X_SEEN_UM] = x_um
    s[c.B_OLDEST] = s[c.B_BEFORE]
    s[c.B_BEFORE] = s[c.B]
    s[c.B] = late[c.B_NOW - c.LATE]
    s[c.LOOSE] = 0
    s[c.HAS_DIPPED] = 0
    s[c.DRIFTS] = flags & d.MISFIT
    s[c.T] = late[c.T_NOW - c.LATE]
    return True
