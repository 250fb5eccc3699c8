"""Arithmetic and framing of a sample in machine code, for boards with ``viper = true``.

Literals replace the constants of decode.py and kernel.py, because a name costs a look-up. A comment
at the start of each function names the constants.

The code is correct with words of 32 bits and of 64 bits. With 64 bits, ``ptr32`` loads unsigned
values: a negative number is then too large by 2**32, and results are too large by multiples of
2**32. ``ptr32`` stores the lower 32 bits, which are always correct. Where the sign matters, ``(x ^
sign) - sign`` corrects a number just loaded, with ``sign = 1 << 31``; with 32 bits it changes
nothing.

No index and no argument is checked. A call takes as long as about fifty additions, and the look-up
of a name or attribute takes as long as twenty. So each step of a sample is one function that uses
only its arguments.
"""

from array import array

import micropython

from .log2 import TABLE


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
def process(
    state: ptr32,
    tables: ptr32,
    counts: ptr32,
    flags: int,
    head: ptr32,
    payload: ptr8,
    encoded: ptr8,
) -> int:
    # state: 0 FLAGS, 1 CONTRAST, 2 BRIGHTNESS, 3 POSITION_UM, 4 FORCE_MN, 5 SAMPLES,
    # 6 FLOOR_SAMPLES, 7 LOG_SAMPLES, 8 TOUCH_ON_MN, 9 TOUCH_OFF_MN, 10 DRIFT_MAX, 11 DRIFT,
    # 12 LEARNS, 13 SEEN, 14 LIGHT, 15 MISFIT_Q12, 16 TOLERANCE_Q12, 17 to 19 FOUND, 20 IDLE_US,
    # 21 LEVEL, 22 ODD_US, 23 AGE_US, 24 EVERY_US, 25 AGE_STEP_US, 26 WANTED, 27 TAKEN, 28 PENDING,
    # 29 EXPOSURE_US, 30 MISSING, 31 ESTIMATED, 32 STREAMED, 33 FOLLOWS, 34 AVERAGE,
    # 35 IDLE_MIN_US, 36 SHIFT, 37 FOLLOWED, 38 to 41 sums of weights times LOGS (coarse contrast,
    # misfit, contrast, brightness), 42 to 47 LOGS, 48 SUMS, 54 FLOOR, 60 REST, 66 DARK.
    # Element 17 is scratch too: storing truncates a sum to 32 bits.
    # Machine code for an element above 31 is longer.
    # tables: 0 SEGMENTS, 1 FORCES, 2 WEIGHTS, 14 BOUNDS; the last bound is at 12 + 2 * segments.
    # flags: 1 TOUCHING, 4 TOO_DARK, 16 MISFIT, 64 NOT_CALIBRATED, 128 LED_OFF, 256 READ, 512 SEND,
    # 1024 TWO. WANTED: 2 CHECK. Result: 4096 COMPLETE, 8192 ODD, 16384 DUE; 28672 is their sum.
    # head: 0 KIND, 1 SEQUENCE, 2 TIME_LOW, 3 TIME_HIGH, 4 GAP, 5 LESS_US.
    # The upper bits of `flags` are the bytes of the frame if only a frame is encoded, see `frame`.
    # payload: flags in byte 7 (HEADER_SIZE); contrast, brightness and position_um in 32-bit words 2
    # to 4; force_mN in bytes 20 and 21.
    sign = 1
    sign <<= 31
    done = 0
    parts = flags
    size = flags >> 16
    if parts & 256:
        taken = state[27]
        state[27] = taken + 1
        for i in range(6):
            n = counts[i]
            if taken:
                n += state[48 + i]
            state[48 + i] = n
        flags = (flags & 255) | state[28]
        state[28] = flags
        if state[23] < state[24]:
            state[23] = state[23] + state[25]
        if taken + 1 < state[34] and flags & 128 == 0:
            if state[26]:
                done = 16384
            return done
        done = 4096
    # Each `break` ends the estimate.
    while done:
        touching = state[0] & 1
        for i in range(1, 5):
            state[i] = 0
        if tables[0] == 0:
            flags |= 64
        if flags & 128:
            flags |= touching
            break

        light = 0
        is_dark = 0
        table = ptr32(TABLE)
        for i in range(6):
            n = state[48 + i]
            light += n
            n = n * state[6] - state[5] * state[54 + i]
            if n <= 0:
                is_dark = 4
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
            state[42 + i] = (exponent << 20) + ((low + 8) >> 4)
        state[14] = light
        flags |= is_dark
        if flags & 68:
            break

        # Coarse contrast and misfit, with the weights of the whole strip (rows 0 and 1); then
        # contrast and brightness, with the weights of the segment (rows 2 and 3).
        first = 2
        for row in range(4):
            if row == 2:
                at = (state[38] ^ sign) - sign
                state[1] = at
                first = 12 + 2 * tables[0]
                while first > 14 and at < (tables[first] ^ sign) - sign:
                    first -= 2
                first = tables[first + 1]
            high = 0
            low = 0
            for i in range(6):
                weight = tables[first]
                n = state[42 + i]
                high += weight * (n >> 13)
                low += weight * (n & 8191)
                first += 1
            state[17] = low
            state[38 + row] = high + (((state[17] ^ sign) - sign) >> 13)

        # Row 0: the segment's table of positions; row 1: the table of forces.
        at = (state[40] ^ sign) - sign
        for row in range(2):
            knots = tables[first]
            low = first + 1
            high = first + knots
            while high - low > 1:
                n = (low + high) >> 1
                if at < (tables[n] ^ sign) - sign:
                    high = n
                else:
                    low = n
            n = (tables[low] ^ sign) - sign
            at -= n
            width = (tables[low + 1] ^ sign) - sign - n
            if at < 0:
                at = 0
            if at > width:
                at = width
            half = width >> 1
            for i in range(3 - row):
                low += knots
                n = tables[low]
                state[17 + i] = tables[low + 1] - n
                state[17 + i] = n + (at * ((state[17 + i] ^ sign) - sign) + half) // width
            if row == 0:
                state[2] = state[41] - state[7] - state[19]
                at = (state[2] ^ sign) - sign
                first = tables[1]
                if at < (tables[first + 1] ^ sign) - sign:
                    flags |= 4
                    break
                state[3] = state[17]
                state[15] = (((state[39] ^ sign) - sign) >> 8) - state[18]
        if flags & 4:
            break
        state[4] = state[17]
        tolerance = (state[18] ^ sign) - sign
        state[16] = tolerance

        misfit = (state[15] ^ sign) - sign
        # A number n is within the tolerance if n + tolerance, unsigned, is at most twice it.
        most = uint(2 * tolerance)
        if uint(misfit + tolerance) > most:
            flags |= 16
        off = misfit - ((state[11] ^ sign) - sign)
        force_mN = state[4]
        least_mN = state[9]
        if touching == 0:
            least_mN = state[8]
            if flags & 16 and uint(off + tolerance) > most:
                least_mN <<= 2
                if force_mN >= least_mN and state[21] and state[25]:
                    state[26] = state[26] | 2
                    break
            state[12] = 3
        if force_mN and force_mN >= least_mN:
            flags |= 1
            if state[12] and force_mN >> 2 >= state[8]:
                state[12] = state[12] - 1
                if state[12] == 0:
                    n = misfit - ((state[13] ^ sign) - sign)
                    if uint(n + tolerance) <= most:
                        n = misfit
                        if n > state[10]:
                            n = state[10]
                        if n + state[10] < 0:
                            n = 0 - state[10]
                        state[11] = n
                        off = misfit - n
                    state[13] = misfit
            if flags & 16 and uint(off + tolerance) <= most:
                flags |= 4
        break
    if done:
        state[0] = flags
        state[31] = flags
        half = (state[27] * state[29]) >> 1
        state[17] = head[2] + head[5] - half
        head[5] = half
        n = (state[17] ^ sign) - sign
        head[3] = (head[3] + (n >> 16)) & 0xFFFF
        head[2] = n & 0xFFFF
    if parts & 512:
        flags = state[31]
        us = state[27] * state[29]
        state[27] = 0
        state[28] = 0
        n = state[20]
        if flags & 1:
            n = 0
        elif n < 1_000_000:
            n += us
        state[20] = n
        if flags & 64 == 0:
            # 24: ODD_COUNTS, 300_000: ODD_US_MAX, 2_000_000: ODD_EVERY_US.
            if flags & 129:
                step = flags & 16
            else:
                n = state[14] // state[5] + 1
                if state[21] == 0:
                    state[21] = n
                n -= state[21]
                step = 0
                if n > 24 or n + 24 < 0:
                    step = 1
            n = 0
            if step:
                n = state[22]
                if n < 300_000:
                    if parts & 1024:
                        us >>= 3
                    n += us
                elif state[23] >= 2_000_000:
                    done |= 8192
            state[22] = n
        n = state[33]
        if n and flags & 128 == 0:
            # 200_000: SETTLED_US, 10: UP, 6: DOWN.
            low = 0
            if n == 1 and state[20] >= 200_000:
                low = 6
            if n > 1 or low:
                state[33] = 1
                state[37] = 1
                step = state[36]
                half = (1 << step) >> 1
                for i in range(6):
                    at = state[66 + i]
                    rest = state[60 + i]
                    n = state[48 + i] * 4
                    if state[5] > 1:
                        n = n // state[5]
                    n = (n << 10) - at - rest
                    if low:
                        n >>= 10 if n > 0 else 6
                    n += rest
                    if n < 0:
                        n = 0
                    state[60 + i] = n
                    state[54 + i] = (at + n + half) >> step
        if state[26] or (state[23] >= state[24] and state[20] >= state[35]):
            done |= 16384
        if state[32]:
            head[0] = state[32]
            head[4] = head[4] | state[30]
            state[30] = 0
            payload[7] = state[0] | head[4]
            words = ptr32(payload)
            for i in range(1, 4):
                words[i + 1] = state[i]
            payload[20] = state[4]
            payload[21] = state[4] >> 8
            size = 22
    if size == 0:
        return done

    payload[0] = head[0]
    for i in range(1, 4):
        payload[2 * i - 1] = head[i]
        payload[2 * i] = head[i] >> 8
    head[1] = (head[1] + 1) & 0xFFFF
    table = ptr32(_CRC)
    crc = 0 - 1
    first = 0
    at = 1
    for i in range(size + 4):
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
    if head[4]:
        n += 1
    if n & 63 == 0:
        encoded[at] = 0
        at += 1
    return done | at


def frame(head, payload, size, encoded):
    return process(head, head, head, size << 16, head, payload, encoded)
