"""The arithmetic and framing of a sample, portable form.

What a sample spends its time on, from counts to framed bytes, in few calls. Boards whose
board.toml says ``viper = true`` get kernel_viper.py in this one's place: the same functions, the
same results bit for bit. Integers of 31 bits only, allocates nothing.

Every sequence of integers is an ``array('i')`` on a board, for the other form reads memory.
"""

from array import array

from .log2 import log2_q20
from .smux import CHANNELS

SCRATCH = 11  # seven logarithms, four sums: what `estimate` works in
CRC_SIZE = 4  # bytes


def accumulate(sums, counts, samples):
    """Add six counts to the sums of `samples` earlier ones; with 0 of them, restart."""
    if samples == 0:
        for i in range(CHANNELS):
            sums[i] = counts[i]
    else:
        for i in range(CHANNELS):
            sums[i] += counts[i]


def follow(rest, floor, sums, samples, dark, shift, up, down):
    """Move the baseline (the counts of the untouched strip) towards a reading.

    Parameters
    ----------
    rest : sequence of int
        The baseline: six counts in Q12, dark subtracted. It moves by 2**-`up` of the difference
        where the reading is above it, by 2**-`down` where below.
    floor : sequence of int
        Output: dark + rest, rounded to Q12 - `shift`; `estimate` subtracts it.
    sums : sequence of int
        Six sums of counts over `samples` samples.
    dark : sequence of int
        Six counts in Q12.
    samples, shift, up, down : int
    """
    half = 1 << shift >> 1
    for i in range(CHANNELS):
        gap = (sums[i] * 4 // samples << 10) - dark[i] - rest[i]
        level = rest[i] + (gap >> (up if gap > 0 else down))
        if level < 0:
            level = 0
        rest[i] = level
        floor[i] = dark[i] + level + half >> shift


def look_up(knots, columns, at, found):
    """Put each column's piecewise-linear value at `at` into `found`; beyond the ends, the end's.

    Parameters
    ----------
    knots : sequence of int
        Ascending.
    columns : tuple of sequences of int
        A value for each knot.
    at : int
    found : sequence of int
        Gets one rounded value for each column.
    """
    low = 0
    high = len(knots) - 1
    while high - low > 1:
        middle = (low + high) >> 1
        if at < knots[middle]:
            high = middle
        else:
            low = middle
    start = knots[low]
    width = knots[low + 1] - start
    offset = min(max(at - start, 0), width)
    half = width >> 1
    for column in range(len(columns)):
        values = columns[column]
        value = values[low]
        found[column] = value + (offset * (values[low + 1] - value) + half) // width


def estimate(calibration, sums, samples, dark, dark_samples, scratch, reading):
    """Estimate contrast, brightness, position in um and force in mN from sums of counts.

    Parameters
    ----------
    calibration : calibration.Calibration or None
    sums, dark : sequence of int
        Six sums of counts over `samples` and over `dark_samples` samples; times the other number
        of samples, at most 2**24.
    samples, dark_samples : int
    scratch : sequence of int
        Of `SCRATCH`, to work in.
    reading : sequence of int
        Gets the four; 0 for what is not known.

    Returns
    -------
    int
        1 if it is too dark for a position, 2 if the spectrum misfits a single press, else 0.
    """
    for i in range(4):
        reading[i] = 0
    if not _take_logs(sums, samples, dark, dark_samples, scratch):
        return 1
    if calibration is None:
        return 0
    coarse, fit = calibration.weights
    reading[0] = contrast = _dot(coarse, scratch)
    fit = _dot(fit, scratch) >> 8
    part = calibration.segments[_below(calibration.bounds, contrast)]
    at = _dot(part.position, scratch)
    brightness = _dot(part.force, scratch) - scratch[CHANNELS]
    look_up(part.contrasts, part.columns, at, scratch)
    reading[1] = brightness = brightness - scratch[2]
    if brightness < calibration.brightnesses[0]:
        return 1
    reading[2] = scratch[0]
    misfit = abs(fit - scratch[1])
    look_up(calibration.brightnesses, calibration.columns, brightness, scratch)
    reading[3] = scratch[0]
    return 2 if misfit > scratch[1] else 0


def _take_logs(sums, samples, dark, dark_samples, logs):
    for i in range(CHANNELS):
        net = sums[i] * dark_samples - samples * dark[i]
        if net <= 0:
            return False
        logs[i] = log2_q20(net)
    logs[CHANNELS] = log2_q20(samples * dark_samples)
    return True


def _dot(weights, logs):
    # Weight (Q13) times logarithm (Q20), in Q20. Split so that nothing passes 31 bits for
    # logarithms below 2**25 and weights whose absolute values add up to 2**16 at most.
    high = low = 0
    for i in range(CHANNELS):
        weight = weights[i]
        log = logs[i]
        high += weight * (log >> 13)
        low += weight * (log & 8191)
    return high + (low >> 13)


def _below(bounds, value):
    # The last i with bounds[i] <= value, or 0.
    i = len(bounds) - 1
    while i > 0 and value < bounds[i]:
        i -= 1
    return i


def _crc_tables():
    # CRC-32, polynomial 0xEDB88320, as zlib.crc32 of CPython; in halves of 16 bits.
    lows = array("H", bytes(512))
    highs = array("H", bytes(512))
    for byte in range(256):
        low = byte
        high = 0
        for _ in range(8):
            odd = low & 1
            low = (low >> 1 | high << 15 & 0x8000) ^ (0x8320 if odd else 0)
            high = high >> 1 ^ (0xEDB8 if odd else 0)
        lows[byte] = low
        highs[byte] = high
    return lows, highs


_LOWS, _HIGHS = _crc_tables()
del _crc_tables  # room on a board


def crc32(data, size, crc):
    """Take the first `size` bytes into a CRC-32.

    Parameters
    ----------
    data : bytes-like
    size : int
    crc : array.array
        ``array("H")`` of the low and the high half, both 0xFFFF at first. The CRC-32 is their
        complement.
    """
    lows = _LOWS
    highs = _HIGHS
    low = crc[0]
    high = crc[1]
    for i in range(size):
        at = (low ^ data[i]) & 0xFF
        low = (low >> 8 | high << 8 & 0xFF00) ^ lows[at]
        high = high >> 8 ^ highs[at]
    crc[0] = low
    crc[1] = high


def cobs_encode(source, size, target):
    """Write the COBS form of the first `size` bytes and its zero byte; return its length."""
    code_at = 0
    write = 1
    for read in range(size):
        byte = source[read]
        if byte:
            target[write] = byte
            write += 1
        if not byte or write - code_at == 255:
            target[code_at] = write - code_at
            code_at = write
            write += 1
    target[code_at] = write - code_at
    target[write] = 0
    return write + 1


_crc = array("H", bytes(4))


def frame(payload, size, encoded):
    """Put the CRC behind the first `size` bytes and write their frame; return its length."""
    crc = _crc
    crc[0] = crc[1] = 0xFFFF
    crc32(payload, size, crc)
    payload[size] = ~crc[0] & 0xFF
    payload[size + 1] = ~crc[0] >> 8 & 0xFF
    payload[size + 2] = ~crc[1] & 0xFF
    payload[size + 3] = ~crc[1] >> 8 & 0xFF
    return cobs_encode(payload, size + CRC_SIZE, encoded)
