"""Arithmetic and framing of a sample in machine code; replaces kernel.py on some boards.

The code is correct with words of 32 bits and of 64 bits. With 64 bits, ``ptr32`` loads unsigned
values: a negative number is then too large by 2**32, and results are too large by multiples of it.
Where the sign matters, ``x - ((x >> 31) + 1 >> 1 << 16 << 16)`` corrects this; with 32 bits it
changes nothing. ``ptr32`` stores the lower 32 bits, which are always correct.

No index and no argument is checked. A call between two functions costs about ten additions, so code
that runs for every channel is written inline.
"""

from array import array

import micropython

from .log2 import TABLE

SCRATCH = 11
CRC_SIZE = 4


@micropython.viper
def accumulate(sums: ptr32, counts: ptr32, samples: int):
    for i in range(6):
        if samples == 0:
            sums[i] = counts[i]
        else:
            sums[i] = sums[i] + counts[i]


@micropython.viper
def follow(
    rest: ptr32,
    floor: ptr32,
    sums: ptr32,
    samples: int,
    dark: ptr32,
    shift: int,
    up: int,
    down: int,
):
    half = 1 << shift >> 1
    for i in range(6):
        level = rest[i]
        gap = ((sums[i] * 4 // samples) << 10) - dark[i] - level
        if gap > 0:
            level += gap >> up
        else:
            level += gap >> down
        if level < 0:
            level = 0
        rest[i] = level
        floor[i] = (dark[i] + level + half) >> shift


@micropython.viper
def look_up(knots, columns, at: int, found: ptr32):
    words = ptr32(knots)
    low = 0
    high = int(len(knots)) - 1
    while high - low > 1:
        middle = (low + high) >> 1
        knot = words[middle]
        knot -= (knot >> 31) + 1 >> 1 << 16 << 16
        if at < knot:
            high = middle
        else:
            low = middle
    start = words[low]
    start -= (start >> 31) + 1 >> 1 << 16 << 16
    width = words[low + 1] - start
    width -= (width >> 31) + 1 >> 1 << 16 << 16
    offset = at - start
    if offset < 0:
        offset = 0
    if offset > width:
        offset = width
    half = width >> 1
    for column in range(int(len(columns))):
        values = ptr32(columns[column])
        value = values[low]
        rise = values[low + 1] - value
        rise -= (rise >> 31) + 1 >> 1 << 16 << 16
        found[column] = value + (offset * rise + half) // width


@micropython.viper
def estimate(
    calibration, sums: ptr32, samples: int, dark: ptr32, dark_samples: int, scratch, reading: ptr32
) -> int:
    logs = ptr32(scratch)
    for i in range(4):
        reading[i] = 0

    table = ptr32(TABLE)
    for i in range(7):
        n = samples * dark_samples
        if i < 6:
            n = sums[i] * dark_samples - samples * dark[i]
            if n <= 0:
                return 1
        # As in log2.log2_q20; its table has no negative number, so no sign is corrected.
        if n >= 1 << 24:
            logs[i] = 24 << 20
            continue
        exponent = 23
        if n < 1 << 8:
            n <<= 16
            exponent -= 16
        if n < 1 << 16:
            n <<= 8
            exponent -= 8
        if n < 1 << 20:
            n <<= 4
            exponent -= 4
        if n < 1 << 22:
            n <<= 2
            exponent -= 2
        if n < 1 << 23:
            n <<= 1
            exponent -= 1
        step = (n >> 14) & 511
        base = table[step]
        fraction = base + (((n & 16383) * (table[step + 1] - base)) >> 14)
        logs[i] = (exponent << 20) + ((fraction + 8) >> 4)
    if not calibration:  # viper has no 'is'
        return 0

    # Contrast and fit by the weights of the whole strip, then position and force by the segment's.
    rows = calibration.weights
    part = rows
    for row in range(4):
        if row == 2:
            contrast = logs[7]
            contrast -= (contrast >> 31) + 1 >> 1 << 16 << 16
            bounds = ptr32(calibration.bounds)
            i = int(len(calibration.bounds)) - 1
            while i > 0:
                bound = bounds[i]
                bound -= (bound >> 31) + 1 >> 1 << 16 << 16
                if contrast >= bound:
                    break
                i -= 1
            part = calibration.segments[i]
            rows = part.weights
        weights = ptr32(rows[row & 1])
        high = 0
        low = 0
        for i in range(6):
            weight = weights[i]
            log = logs[i]
            high += weight * (log >> 13)
            low += weight * (log & 8191)
        low -= (low >> 31) + 1 >> 1 << 16 << 16
        logs[7 + row] = high + (low >> 13)
    reading[0] = contrast
    at = logs[9]
    at -= (at >> 31) + 1 >> 1 << 16 << 16
    brightness = logs[10] - logs[6]
    fit = logs[8]
    fit -= (fit >> 31) + 1 >> 1 << 16 << 16
    fit >>= 8

    look_up(part.contrasts, part.columns, at, scratch)
    brightness -= logs[2]
    brightness -= (brightness >> 31) + 1 >> 1 << 16 << 16
    reading[1] = brightness
    knots = ptr32(calibration.brightnesses)
    least = knots[0]
    least -= (least >> 31) + 1 >> 1 << 16 << 16
    if brightness < least:
        return 1
    reading[2] = logs[0]
    logs[2] = fit - logs[1]

    look_up(calibration.brightnesses, calibration.columns, brightness, scratch)
    reading[3] = logs[0]
    return 0


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
def crc32(data: ptr8, size: int, crc: ptr16):
    table = ptr32(_CRC)
    value = crc[0] | crc[1] << 16
    for i in range(size):
        value ^= data[i]
        value = (value >> 4 & 0x0FFFFFFF) ^ table[value & 15]
        value = (value >> 4 & 0x0FFFFFFF) ^ table[value & 15]
    crc[0] = value & 0xFFFF
    crc[1] = value >> 16 & 0xFFFF


@micropython.viper
def cobs_encode(source: ptr8, size: int, target: ptr8) -> int:
    code_at = 0
    write = 1
    for read in range(size):
        byte = source[read]
        if byte:
            target[write] = byte
            write += 1
        if byte == 0 or write - code_at == 255:
            target[code_at] = write - code_at
            code_at = write
            write += 1
    target[code_at] = write - code_at
    target[write] = 0
    return write + 1


_crc = array("H", bytes(4))


@micropython.viper
def frame(payload, size: int, encoded) -> int:
    crc = ptr16(_crc)
    crc[0] = 0xFFFF
    crc[1] = 0xFFFF
    crc32(payload, size, _crc)
    data = ptr8(payload)
    for i in range(4):
        data[size + i] = crc[i >> 1] >> ((i & 1) << 3) & 0xFF ^ 0xFF
    return int(cobs_encode(payload, size + 4, encoded))
