"""Processes a reading while there may be two fingers, in machine code.

Replaces pair.py on boards with ``viper = true`` in board.toml.

The code is correct with words of 32 bits and of 64 bits, see kernel_viper.py. It checks no
argument.
"""

import micropython

from ..reading import decode as d
from . import state as c
from .evidence import guess, has_almost_left, remains, slides
from .locate import estimate, noise


@micropython.viper
def watch(s: ptr32, late: ptr32, b: int, state) -> int:
    # Each `if`, `and` and `or` takes 12 bytes of flash, and each comparison 20. So a condition is
    # often the sign bit of differences. The first three locals are in registers.
    late = ptr32(uint(late) + 4 * c.LATE)
    sign = 1
    sign <<= 31
    mask = c.TICKS - 1
    flags = s[c.FLAGS_NOW]
    fits = late[c.FITS - c.LATE]
    if flags < c.CHECKED:
        if (
            (
                0
                - (
                    (flags & (d.TOUCHING | d.NOT_CALIBRATED | d.SATURATED) ^ d.TOUCHING)
                    | late[c.STUCK_T - c.LATE]
                )
            )
            | (s[c.LENGTH_UM] - 1)
            | (
                (late[c.FORCE_NOW_MN - c.LATE] - late[c.RELEASE_MN - c.LATE])
                & ((flags & (d.MISFIT | d.TOO_DARK)) - 1)
            )
        ) & sign:
            return -1
        s[c.HAS_DIPPED] = s[c.HAS_DIPPED] | late[c.LEAVING - c.LATE]
        late[c.LEAVING - c.LATE] = 0
        fits = ((flags >> d.MISFIT_BIT) & ((flags >> d.TOO_DARK_BIT) ^ 1) & 1) ^ 1
        late[c.FITS - c.LATE] = fits
        if fits:
            late[c.FORCE_MN - c.LATE] = late[c.FORCE_NOW_MN - c.LATE]
    b_last = (s[c.B_SEEN] ^ sign) - sign
    risen = b - b_last
    falls = s[c.FALLS]
    now = late[c.T_NOW - c.LATE]
    grows = c.RISEN - risen
    if grows & ((c.LIFTS_T - 1) - (s[c.T] - s[c.FELL] & mask)) & sign and has_almost_left(state):
        return c.NEXT

    peak = (s[c.PEAK] ^ sign) - sign
    low = (s[c.LOW] ^ sign) - sign
    first = (s[c.B] ^ sign) - sign
    x_um = (late[c.X_NOW_UM - c.LATE] ^ sign) - sign
    if (low + c.LOST - peak) & (low + c.GROWN - b) & (first + c.BOTH - peak) & sign:
        s[c.THIRD] = 1
    if b >= peak:
        peak = b
        low = b
        s[c.PEAK] = b
        late[c.X_PEAK_UM - c.LATE] = x_um
    if b < low:
        low = b
    s[c.LOW] = low
    if (b - s[c.LEAST]) & sign:
        s[c.LEAST] = b
    x1_um = (s[c.X_UM] ^ sign) - sign
    away_um = x_um - x1_um
    away_um = (away_um ^ (away_um >> 31)) - (away_um >> 31)
    off_um = (s[c.X_SEEN_UM] ^ sign) - sign
    late[c.X_LAST_UM - c.LATE] = off_um
    late[c.B_LAST - c.LATE] = b_last
    s[c.X_SEEN_UM] = x_um
    s[c.B_SEEN] = b
    step_um = off_um - x1_um
    step_um = away_um - ((step_um ^ (step_um >> 31)) - (step_um >> 31))
    late[c.STEP_LAST_UM - c.LATE] = s[c.STEP_UM]
    s[c.STEP_UM] = step_um
    off_um = x_um - off_um
    off_um = (off_um ^ (off_um >> 31)) - (off_um >> 31)
    steady = 1
    if off_um >= c.REST_UM:
        if b < b_last:
            b_last = b
        steady = (
            off_um - ((int(noise(late[c.NOISE_PRODUCT - c.LATE], b_last)) * 7) >> 1)
        ) >> 31 & 1
    if grows < 0:
        s[c.B_BOTH] = 0
    elif s[c.RESTED] > steady:
        s[c.X_BOTH_UM] = late[c.X_LAST_UM - c.LATE]
        s[c.B_BOTH] = late[c.B_LAST - c.LATE]
        s[c.FIT_BOTH] = s[c.FIT_SEEN]
    s[c.RESTED] = steady
    s[c.FIT_SEEN] = fits
    seen = (s[c.SEEN] ^ sign) - sign
    if (0 - (fits & steady)) & (0 - 1 - seen) & sign:
        seen += (seen - c.SEEN_MAX) >> 31 & 1
    else:
        seen = fits - 1
        s[c.SINCE] = now
        s[c.B_SINCE] = b
    s[c.SEEN] = seen
    late[c.ODD - c.LATE] = late[c.ODD - c.LATE] | (fits ^ 1)

    second = s[c.SECOND]
    what = 0
    peak -= c.EVEN
    dims = b - peak
    off_um = x_um - late[c.HINT_UM - c.LATE]
    if (
        fits & s[c.KNOWN] & s[c.PAIR] & (second ^ 1)
        and (
            (c.CHANGED - risen)
            | (c.CHANGED + risen)
            | ((0 - falls) & (0 - step_um) & (step_um - c.FAST_UM))
            | (dims & (0 - 1 - ((off_um + (c.NEAR_UM - 1)) | ((c.NEAR_UM - 1) - off_um))))
        )
        & sign
    ):
        what = int(remains(state))
    if dims < 0:
        if ((0 - (second & (falls ^ 1))) & (0 - c.EVEN - risen)) & sign and slides(state):
            dims = 0
        if dims:
            s[c.IS_EVEN] = 0
            s[c.RISES] = 0
            if (falls - s[c.KNOWN]) & (risen + c.CALM) & (c.REST_UM - step_um) & sign:
                falls = 1
                s[c.FALLS] = 1
                s[c.FELL] = now

    even = s[c.IS_EVEN]
    if second:
        x0_um = (late[c.X_SECOND_UM - c.LATE] ^ sign) - sign
        b0 = (late[c.B_SECOND - c.LATE] ^ sign) - sign
        off_um = x_um - x0_um
        if even == 0:
            if (
                (off_um + (c.NEAR_UM - 1))
                | ((c.NEAR_UM - 1) - off_um)
                | (b0 + (c.MORE - 1) - b)
                | (fits - 1)
            ) & sign == 0:
                s[c.T] = now
                return c.LIFTED
        else:
            if estimate(state, x1_um, first, fits):
                off_um = ((s[c.FOUND_UM] ^ sign) - sign) - x0_um
                is_near = ((off_um + (c.NEAR_UM - 1)) | ((c.NEAR_UM - 1) - off_um)) & sign == 0
                if is_near and (s[c.PEAK] ^ sign) - sign == b:
                    late[c.X_SECOND_UM - c.LATE] = s[c.FOUND_UM]
                    late[c.B_SECOND - c.LATE] = s[c.FOUND_B]
                if is_near or slides(state):
                    late[c.X_PAIR_UM - c.LATE] = x_um
                    late[c.B_PAIR - c.LATE] = b
                    s[c.GUESSED] = 0
                    s[c.T] = now
                    return c.MOVED
            x0_um = (late[c.X_PAIR_UM - c.LATE] ^ sign) - sign
            b0 = (late[c.B_PAIR - c.LATE] ^ sign) - sign
            fits = -1
        if even | falls:
            is_there = 0
            if estimate(state, x0_um, b0, fits):
                is_there = 1
            at_um = (s[c.FOUND_UM] ^ sign) - sign
            off_um = at_um - ((late[c.X_GUESS_UM - c.LATE] ^ sign) - sign)
            late[c.X_GUESS_UM - c.LATE] = at_um
            late[c.B_GUESS - c.LATE] = s[c.FOUND_B]
            away_um = at_um - x1_um
            step_um = at_um - late[c.X_SECOND_UM - c.LATE]
            is_there = (
                is_there
                & (((away_um + c.APART_UM) | (c.APART_UM - away_um)) >> 31)
                & (((step_um + c.APART_UM) | (c.APART_UM - step_um)) >> 31)
            )
            off_um = (off_um ^ (off_um >> 31)) - (off_um >> 31)
            if s[c.GUESSED] & is_there & (((off_um - (c.APART_UM + 1)) & sign) >> 31):
                off_um += (s[c.FOUND_SLACK_UM] * c.SOON) >> 3
            else:
                off_um = 0
            s[c.GUESSED] = is_there
            if (0 - (even | off_um) | (c.FALL_T - 1) - (now - s[c.FELL] & mask)) & sign:
                s[c.T] = now
                if off_um | (even ^ 1):
                    off_um = (off_um << 8) + c.FADED - even
                return off_um
        else:
            s[c.GUESSED] = 0
    else:
        late[c.X_PAIR_UM - c.LATE] = x_um
        late[c.B_PAIR - c.LATE] = b
        if (even | (s[c.RISES] & s[c.PAIR]) | s[c.GUESSED]) > (
            s[c.THIRD] | s[c.HAS_DIPPED]
        ) and guess(state):
            what |= c.FOUND
    s[c.PAIR] = 1
    if (
        what & (c.SINGLE | c.ENDS)
        or (0 - seen) & (c.REST_T * seen - 1 - (now - s[c.SINCE] & mask) * (seen + 1)) & sign
    ):
        what |= c.REMAINS
    s[c.T] = now
    return what
