"""Arithmetic and framing of a sample in machine code, for boards with ``viper = true``.

The code is correct with words of 32 bits and of 64 bits. With 64 bits, ``ptr32`` loads unsigned
values: a negative number is then too large by 2**32, and results are too large by multiples of
2**32. ``ptr32`` stores the lower 32 bits, which are always correct. Where the sign matters, ``(x ^
_SIGN) - _SIGN`` corrects a number just loaded. With 32 bits, it changes nothing: a build for boards
omits it.

No index and no argument is checked. A call takes as long as about fifty additions, and the look-up
of a name or attribute takes as long as twenty. So a sample takes two calls, `process` and `frame`,
which look up little. A build replaces the names of constants by their values.
"""

from array import array

import micropython

from ..sensor.smux import CHANNELS
from . import decode as d
from .log2 import GUARD, TABLE, Q
from .lone import begin, confirm, is_doubtful, learn, move
from .sticking import unstick

_SIGN = 1 << 31


def _crc_table():
    # Table for half a byte; a table for a whole byte would be sixteen times as large.
    table = array("I", bytes(64))
    for half in range(16):
        crc = half
        for _ in range(4):
            crc = crc >> 1 ^ (0xEDB88320 if crc & 1 else 0)
        table[half] = crc
    return table


_CRC = _crc_table()


@micropython.viper
def process(work, flags: int) -> int:
    # Element `FOUND` is scratch too: storing truncates a sum to 32 bits.
    state = ptr32(work[d.STATE])
    tables = ptr32(work[d.TABLES])
    counts = ptr32(work[d.COUNTS])
    head = ptr32(work[d.HEAD])
    taken = state[d.TAKEN]
    state[d.TAKEN] = taken + 1
    for i in range(CHANNELS):
        n = counts[i]
        if taken:
            n += state[d.SUMS + i]
        state[d.SUMS + i] = n
    if state[d.AGE_US] < state[d.EVERY_US]:
        state[d.AGE_US] = state[d.AGE_US] + state[d.AGE_STEP_US]
    is_off = flags & d.LED_OFF
    flags |= state[d.PENDING]
    state[d.PENDING] = flags
    if taken + 1 < state[d.AVERAGE] and is_off == 0:
        state[d.DUE] = 1 if state[d.WANTED] else 0
        return 0
    # Each `break` ends the estimate.
    has_faded = 0
    while True:
        touching = state[d.TOUCHED]
        for i in range(d.CONTRAST, d.FORCE_MN + 1):
            state[i] = 0
        if tables[d.SEGMENTS] == 0:
            flags |= d.NOT_CALIBRATED
        if flags & d.LED_OFF:
            break
        state[d.TOUCHED] = 0

        light = 0
        is_dark = 0
        state[d.BELOW] = 0
        table = ptr32(TABLE)
        for i in range(CHANNELS):
            n = state[d.SUMS + i]
            light += n
            n = n * state[d.FLOOR_SAMPLES] - state[d.SAMPLES] * state[d.FLOOR + i]
            if n <= 0:
                if is_dark == 0:
                    n += d.BELOW_COUNTS * state[d.SAMPLES] * state[d.FLOOR_SAMPLES]
                    state[d.BELOW] = 1 if n < 0 else 0
                is_dark = d.TOO_DARK
                continue
            # As in log2.log2_q20; its table has no negative number, so no sign is corrected.
            exponent = 23
            while n < 1 << 16:
                n <<= 8
                exponent -= 8
            while n < 1 << 23:
                n <<= 1
                exponent -= 1
            step = (n >> 14) & 511
            low = table[step]
            low += ((n & 16383) * (table[step + 1] - low)) >> 14
            state[d.LOGS + i] = (exponent << Q) + ((low + 8) >> GUARD)
        state[d.LIGHT] = light
        if is_dark and touching and flags & d.NOT_CALIBRATED == 0:  # as kernel._has_faded
            if state[d.BELOW] and state[d.AGE_STEP_US] and state[d.STUCK] < d.STUCK_LEAST:
                has_faded = 1 - state[d.FAINT]
            state[d.FAINT] = has_faded
            if has_faded:
                break
        flags |= is_dark
        if flags & (d.TOO_DARK | d.NOT_CALIBRATED):
            break

        # Coarse contrast and misfit, with the weights of the whole strip (rows 0 and 1); then
        # contrast and brightness, with the weights of the segment (rows 2 and 3).
        first = d.WEIGHTS
        for row in range(4):
            if row == 2:
                at = (state[d.COARSE_SUM] ^ _SIGN) - _SIGN
                state[d.CONTRAST] = at
                first = (d.BOUNDS - 2) + 2 * tables[d.SEGMENTS]
                while first > d.BOUNDS and at < (tables[first] ^ _SIGN) - _SIGN:
                    first -= 2
                first = tables[first + 1]
            high = 0
            low = 0
            for i in range(CHANNELS):
                weight = tables[first]
                n = state[d.LOGS + i]
                high += weight * (n >> 13)
                low += weight * (n & 8191)
                first += 1
            state[d.FOUND] = low
            state[d.COARSE_SUM + row] = high + (((state[d.FOUND] ^ _SIGN) - _SIGN) >> 13)

        # Row 0: the segment's table of positions; row 1: the table of forces.
        beyond = 0
        over_um = 0
        cross = (tables[d.CROSS] ^ _SIGN) - _SIGN
        at = (state[d.CONTRAST_SUM] ^ _SIGN) - _SIGN
        for row in range(2):
            knots = tables[first]
            low = first + 1
            high = first + knots
            while high - low > 1:
                n = (low + high) >> 1
                if at < (tables[n] ^ _SIGN) - _SIGN:
                    high = n
                else:
                    low = n
            n = (tables[low] ^ _SIGN) - _SIGN
            at -= n
            width = (tables[low + 1] ^ _SIGN) - _SIGN - n
            half = width >> 1
            if row:
                if at > width + d.BEYOND_Q20:
                    beyond = d.TOO_DARK
            elif cross == 0 and (at + half < 0 or at > width + half):
                beyond = d.TOO_DARK
            n = at
            if at < 0:
                at = 0
            if at > width:
                at = width
            n -= at
            if row == 0 and n and cross:
                # How far the contrast is beyond the table.
                state[d.FOUND] = tables[low + knots + 1] - tables[low + knots]
                over_um = (state[d.FOUND] ^ _SIGN) - _SIGN
                if n > width or n + width < 0:
                    n = n if over_um > 0 else 0 - n
                    over_um = d.OUTSIDE_UM if n > 0 else 0 - d.OUTSIDE_UM
                else:
                    over_um = n * over_um // width
            columns = 3 - row
            if cross:
                columns += 2 - row
            for i in range(columns):
                low += knots
                n = tables[low]
                state[d.FOUND + i] = tables[low + 1] - n
                state[d.FOUND + i] = (
                    n + (at * ((state[d.FOUND + i] ^ _SIGN) - _SIGN) + half) // width
                )
            if row == 0:
                state[d.BRIGHTNESS] = (
                    state[d.BRIGHTNESS_SUM] - state[d.LOG_SAMPLES] - state[d.FOUND + 2]
                )
                at = (state[d.BRIGHTNESS] ^ _SIGN) - _SIGN
                first = tables[d.FORCES]
                if at < (tables[first + 1] ^ _SIGN) - _SIGN:
                    flags |= d.TOO_DARK
                    break
                state[d.POSITION_UM] = state[d.FOUND]
                n = (state[d.MISFIT_SUM] ^ _SIGN) - _SIGN
                state[d.MISFIT_Q12] = (n >> 8) - state[d.FOUND + 1]
        if flags & d.TOO_DARK:
            break
        state[d.FORCE_MN] = state[d.FOUND]
        tolerance = (state[d.FOUND + 1] ^ _SIGN) - _SIGN
        state[d.TOLERANCE_Q12] = tolerance
        if cross:
            n = (state[d.FOUND + 2] ^ _SIGN) - _SIGN
            at = (state[d.FOUND + 4] ^ _SIGN) - _SIGN
            state[d.MISFIT_Q12] = state[d.MISFIT_Q12] - ((at * n) >> 12)
            at = (state[d.FOUND + 3] ^ _SIGN) - _SIGN
            at = (at * n) >> 12
            at += ((state[d.POSITION_UM] ^ _SIGN) - _SIGN) + over_um
            half = cross >> d.FAR_LOG2
            if at + half < 0 or at > cross + half:
                beyond = d.TOO_DARK
            if at < 0:
                at = 0
            elif at > cross:
                at = cross
            state[d.POSITION_UM] = at

        misfit = (state[d.MISFIT_Q12] ^ _SIGN) - _SIGN
        # A number n is within the tolerance if n + tolerance, unsigned, is at most twice it.
        most = uint(2 * tolerance)
        if uint(misfit + tolerance) > most:
            flags |= d.MISFIT
        late = ptr32(uint(state) + 4 * d.LATE)
        off = (state[d.POSITION_UM] - late[d.MIDDLE_UM - d.LATE]) >> 10
        off = (((state[d.SLOPE] ^ _SIGN) - _SIGN) * off) >> 10
        off = misfit - ((state[d.DRIFT] ^ _SIGN) - _SIGN) - off
        if off > d.OFF_MAX:
            off = d.OFF_MAX
        if off + d.OFF_MAX < 0:
            off = 0 - d.OFF_MAX
        state[d.OFF_Q12] = off
        if flags & d.MISFIT and state[d.AGE_STEP_US] == 0:
            n = d.ALIEN * tolerance + state[d.DRIFT_MAX]
            if uint(off + n) > uint(2 * n):
                state[d.FAINT] = 0
                break
        force_mN = state[d.FORCE_MN]
        least_mN = state[d.TOUCH_OFF_MN]
        step = 0
        if touching:
            n = (state[d.BRIGHTNESS] ^ _SIGN) - _SIGN
            if n < ((state[d.PEAK] ^ _SIGN) - _SIGN) - d.LEFT:
                step = 1
            if (
                flags & d.MISFIT
                and uint(off + d.ALIEN * tolerance) > uint(2 * d.ALIEN * tolerance)
                and state[d.AGE_US] >= d.ODD_US_MAX
                and state[d.AGE_STEP_US]
            ):
                state[d.WANTED] = state[d.WANTED] | d.CHECK
        else:
            least_mN = state[d.TOUCH_ON_MN]
            if flags & d.MISFIT and uint(off + tolerance) > most:
                least_mN <<= 2
                if force_mN >= least_mN and state[d.LEVEL] and state[d.AGE_STEP_US]:
                    state[d.WANTED] = state[d.WANTED] | d.CHECK
                    break
            state[d.LEARNS] = 3
        faint = 0
        if force_mN and force_mN >= least_mN:
            if state[d.LEARNS] and force_mN >> 2 >= state[d.TOUCH_ON_MN]:
                state[d.LEARNS] = state[d.LEARNS] - 1
                if state[d.LEARNS] == 0:
                    off = int(confirm(work[d.STATE]))
            if step == 0 or state[d.FAINT] == 0:
                faint = step
                flags |= d.TOUCHING
                state[d.TOUCHED] = d.TOUCHING
                if flags & d.MISFIT == 0:
                    flags |= beyond
                elif uint(off + tolerance) <= most:
                    flags |= d.TOO_DARK
        state[d.FAINT] = faint
        break
    us = state[d.TAKEN] * state[d.EXPOSURE_US]
    if has_faded:
        state[d.WANTED] = state[d.WANTED] | d.CHECK
        state[d.TOUCHED] = d.TOUCHING
        flags |= d.MISFIT | d.TOUCHING
    elif flags & d.TOUCHING:  # as kernel._follow_touch
        if touching == 0:
            begin(work[d.STATE])
        late = ptr32(uint(state) + 4 * d.LATE)
        n = late[d.BEGUN_US - d.LATE]
        if n < d.BEGUN_US_MAX:
            late[d.BEGUN_US - d.LATE] = n + us
        if state[d.FORCE_MN] >> 2 >= state[d.TOUCH_ON_MN]:
            at = state[d.POSITION_UM]
            n = at - late[d.X_FIRM_UM - d.LATE]
            if n > d.MOVED_UM or n + d.MOVED_UM < 0:
                move(work[d.STATE])
            n = (late[d.MEAN - d.LATE] ^ _SIGN) - _SIGN
            n += ((((state[d.OFF_Q12] ^ _SIGN) - _SIGN) << 4) - n) >> 2
            late[d.MEAN - d.LATE] = n
            late[d.X_FIRM_UM - d.LATE] = at
            n = state[d.TOLERANCE_Q12]
            if n < late[d.TOLERANCE_FIRM - d.LATE]:
                late[d.TOLERANCE_FIRM - d.LATE] = n
        if state[d.DOUBT] and int(is_doubtful(work[d.STATE], work[d.TABLES])):
            flags = (flags | d.TOO_DARK | d.MISFIT) ^ d.TOO_DARK
    elif touching and flags & d.LED_OFF == 0:
        learn(work[d.STATE])
    state[d.FLAGS] = flags
    half = us >> 1
    state[d.FOUND] = head[d.TIME_LOW] + head[d.LESS_US] - half
    head[d.LESS_US] = half
    n = (state[d.FOUND] ^ _SIGN) - _SIGN
    head[d.TIME_HIGH] = (head[d.TIME_HIGH] + (n >> 16)) & 0xFFFF
    head[d.TIME_LOW] = n & 0xFFFF
    use = work[d.USE]
    two = int(use()) if use else 0

    state[d.TAKEN] = 0
    state[d.PENDING] = 0
    n = state[d.IDLE_US]
    if state[d.TOUCHED]:
        n = 0
    elif n < d.IDLE_US_MAX:
        n += us
    state[d.IDLE_US] = n
    if flags & d.NOT_CALIBRATED == 0:
        if flags & (d.TOUCHING | d.LED_OFF):
            step = flags & d.MISFIT
        else:
            n = state[d.LIGHT] // state[d.SAMPLES] + 1 - (state[d.STUCK] >> 8)
            if state[d.LEVEL] == 0:
                at = 0
                for i in range(CHANNELS):
                    at += state[d.FLOOR + i]
                at = at // state[d.FLOOR_SAMPLES] + 1
                if state[d.STUCK] >= d.STUCK_LEAST:
                    at -= state[d.STUCK] >> 8
                state[d.LEVEL] = at
            n -= state[d.LEVEL]
            step = 0
            if n > d.ODD_COUNTS or n + d.ODD_COUNTS < 0:
                step = 1
        n = 0
        if step:
            n = state[d.ODD_US]
            if n < d.ODD_US_MAX:
                step = us >> 3 if two else us
                if state[d.BELOW]:
                    step <<= d.BELOW_SHIFT
                n += step
            elif state[d.AGE_US] >= d.ODD_EVERY_US and state[d.AGE_STEP_US]:
                state[d.WANTED] = state[d.WANTED] | d.CHECK
        state[d.ODD_US] = n
    if flags & (d.LED_OFF | d.NOT_CALIBRATED) == 0 and (state[d.PEAK] or flags & d.TOUCHING):
        unstick(work[d.STATE], flags, us)
    n = state[d.WANTED]
    if state[d.AGE_US] >= state[d.EVERY_US] and state[d.IDLE_US] >= state[d.IDLE_MIN_US]:
        n = 1
    if state[d.TOUCHED] and state[d.AGE_US] >= state[d.SHADE_US]:
        late = ptr32(uint(state) + 4 * d.LATE)
        if late[d.BEGUN_US - d.LATE] >= d.SHADED_US:
            n = 1
    state[d.DUE] = 1 if n else 0
    if state[d.STREAMED] == 0:
        return 0

    head[d.KIND] = state[d.STREAMED]
    head[d.GAP] = head[d.GAP] | state[d.MISSING]
    state[d.MISSING] = 0
    payload = ptr8(work[d.PAYLOAD])
    payload[d.HEADER_SIZE] = state[d.FLAGS] | head[d.GAP]
    words = ptr32(payload)
    for i in range(d.CONTRAST, d.FORCE_MN):
        words[i + ((d.HEADER_SIZE + 1) // 4 - d.CONTRAST)] = state[i]
    payload[d.TOUCH_SIZE - 2] = state[d.FORCE_MN]
    payload[d.TOUCH_SIZE - 1] = state[d.FORCE_MN] >> 8
    return int(frame(work[d.HEAD], work[d.PAYLOAD], d.TOUCH_SIZE, work[d.ENCODED]))


@micropython.viper
def frame(head: ptr32, payload: ptr8, size: int, encoded: ptr8) -> int:
    payload[d.KIND] = head[d.KIND]
    for i in range(d.SEQUENCE, d.GAP):
        payload[2 * i - 1] = head[i]
        payload[2 * i] = head[i] >> 8
    head[d.SEQUENCE] = (head[d.SEQUENCE] + 1) & 0xFFFF
    table = ptr32(_CRC)
    crc = 0 - 1
    first = 0
    at = 1
    for i in range(size + d.CRC_SIZE):
        if i < size:
            n = payload[i]
            crc ^= n
            crc = (crc >> 4 & 0x0FFFFFFF) ^ table[crc & 15]
            crc = (crc >> 4 & 0x0FFFFFFF) ^ table[crc & 15]
        else:
            n = (crc & 255) ^ 255
            crc >>= 8
        if n:
            encoded[at] = n
            at += 1
        if n == 0 or at - first == 255:
            encoded[first] = at - first
            first = at
            at += 1
    encoded[first] = at - first
    encoded[at] = 0
    at += 1
    n = at
    if head[d.GAP]:
        n += 1
    if n & 63 == 0:
        encoded[at] = 0
        at += 1
    return at
