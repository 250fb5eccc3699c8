"""Arithmetic and framing of a sample in machine code; replaces kernel.py on some boards.

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


@micropython.viper
def unpack(burst: ptr8, counts: ptr32, at: int) -> int:
    # 6: CHANNELS. Each count has two bytes, the low byte first.
    most = 0
    for i in range(6):
        count = burst[at] | burst[at + 1] << 8
        at += 2
        counts[i] = count
        if count > most:
            most = count
    return most


@micropython.viper
def accumulate(sums: ptr32, counts: ptr32, samples: int):
    # 6: CHANNELS. With 0 earlier samples, the sums start with these counts.
    for i in range(6):
        n = counts[i]
        if samples:
            n += sums[i]
        sums[i] = n


@micropython.viper
def estimate(state: ptr32, tables: ptr32, sums: ptr32, floor: ptr32, flags: int):
    # state: 0 FLAGS, 1 CONTRAST, 2 BRIGHTNESS, 3 POSITION_UM, 4 FORCE_MN, 5 SAMPLES,
    # 6 FLOOR_SAMPLES, 7 LOG_SAMPLES, 8 TOUCH_ON_MN, 9 TOUCH_OFF_MN, 10 DRIFT_MAX, 11 DRIFT,
    # 12 LEARNS, 13 SEEN, 14 LIGHT, 15 MISFIT_Q12, 16 TOLERANCE_Q12, 17 to 22 LOGS, 23 to 26 sums
    # of weights times LOGS (coarse contrast, misfit, contrast, brightness), 27 to 29 FOUND.
    # Element 27 is scratch too: storing truncates a sum to 32 bits.
    # tables: 0 SEGMENTS, 1 FORCES, 2 WEIGHTS, 14 BOUNDS; the last bound is at 12 + 2 * segments.
    # flags: 1 TOUCHING, 4 TOO_DARK, 16 MISFIT, 64 NOT_CALIBRATED, 128 LED_OFF.
    sign = 1
    sign <<= 31
    touching = state[0] & 1
    for i in range(1, 5):
        state[i] = 0
    if tables[0] == 0:
        flags |= 64
    if flags & 128:
        state[0] = flags | touching
        return

    light = 0
    is_dark = 0
    logs = ptr32(TABLE)
    for i in range(6):
        n = sums[i]
        light += n
        n = n * state[6] - state[5] * floor[i]
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
        low = logs[step]
        low += ((n & 16383) * (logs[step + 1] - low)) >> 14
        state[17 + i] = (exponent << 20) + ((low + 8) >> 4)
    state[14] = light
    if is_dark or flags & 64:
        state[0] = flags | is_dark
        return

    # Coarse contrast and misfit, with the weights of the whole strip (rows 0 and 1); then contrast
    # and brightness, with the weights of the segment (rows 2 and 3).
    first = 2
    for row in range(4):
        if row == 2:
            at = (state[23] ^ sign) - sign
            state[1] = at
            first = 12 + 2 * tables[0]
            while first > 14 and at < (tables[first] ^ sign) - sign:
                first -= 2
            first = tables[first + 1]
        high = 0
        low = 0
        for i in range(6):
            weight = tables[first]
            n = state[17 + i]
            high += weight * (n >> 13)
            low += weight * (n & 8191)
            first += 1
        state[27] = low
        state[23 + row] = high + (((state[27] ^ sign) - sign) >> 13)

    # Row 0: the segment's table of positions; row 1: the table of forces.
    at = (state[25] ^ sign) - sign
    for row in range(2):
        size = tables[first]
        low = first + 1
        high = first + size
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
            low += size
            n = tables[low]
            state[27 + i] = tables[low + 1] - n
            state[27 + i] = n + (at * ((state[27 + i] ^ sign) - sign) + half) // width
        if row == 0:
            state[2] = state[26] - state[7] - state[29]
            at = (state[2] ^ sign) - sign
            first = tables[1]
            if at < (tables[first + 1] ^ sign) - sign:
                state[0] = flags | 4
                return
            state[3] = state[27]
            state[15] = (((state[24] ^ sign) - sign) >> 8) - state[28]
    state[4] = state[27]
    tolerance = (state[28] ^ sign) - sign
    state[16] = tolerance

    misfit = (state[15] ^ sign) - sign
    # A number n is within the tolerance if n + tolerance, unsigned, is at most twice the tolerance.
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
    state[0] = flags


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
def frame(head: ptr32, payload: ptr8, size: int, encoded: ptr8) -> int:
    # head: 0 KIND, 1 SEQUENCE, 2 TIME_LOW, 3 TIME_HIGH; the CRC adds CRC_SIZE = 4 bytes.
    payload[0] = head[0]
    for i in range(1, 4):
        payload[2 * i - 1] = head[i]
        payload[2 * i] = head[i] >> 8
    head[1] = (head[1] + 1) & 0xFFFF
    table = ptr32(_CRC)
    crc = 0 - 1
    for i in range(size):
        crc ^= payload[i]
        crc = (crc >> 4 & 0x0FFFFFFF) ^ table[crc & 15]
        crc = (crc >> 4 & 0x0FFFFFFF) ^ table[crc & 15]
    for _ in range(4):
        payload[size] = crc ^ 0xFF
        crc >>= 8
        size += 1
    code_at = 0
    write = 1
    for i in range(size):
        byte = payload[i]
        if byte:
            encoded[write] = byte
            write += 1
        if byte == 0 or write - code_at == 255:
            encoded[code_at] = write - code_at
            code_at = write
            write += 1
    encoded[code_at] = write - code_at
    encoded[write] = 0
    return write + 1


@micropython.viper
def touch(head, payload, state, encoded) -> int:
    # payload: flags in byte 7 (HEADER_SIZE); contrast, brightness and position_um in 32-bit words 2
    # to 4; force_mN in 16-bit word 10; 22 bytes (TOUCH_SIZE). state: as in `estimate`. head: 4 GAP.
    words = ptr32(state)
    body = ptr32(payload)
    ptr8(payload)[7] = words[0] | ptr32(head)[4]
    for i in range(1, 4):
        body[i + 1] = words[i]
    ptr16(payload)[10] = words[4]
    return int(frame(head, payload, 22, encoded))
