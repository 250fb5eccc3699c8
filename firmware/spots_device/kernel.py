"""Arithmetic and framing of a sample in portable Python.

These functions take most of the time of a sample, from counts to framed bytes. Boards with
``viper = true`` in board.toml get kernel_viper.py instead of this file: the same functions with
identical results, in machine code. Integers of 31 bits only; allocates nothing.

On a board, every sequence of integers must be an ``array('i')``, because kernel_viper.py reads
their memory directly.
"""

from array import array

from .log2 import log2_q20
from .smux import CHANNELS

SCRATCH = 11  # length of the work array of `estimate`: seven logarithms, four sums
CRC_SIZE = 4  # bytes of a CRC-32


def accumulate(sums, counts, samples):
    """Add six counts to the sums of `samples` earlier samples; with 0 samples, start new sums."""
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
        The baseline, changed in place: six dark-subtracted counts in Q12.
    floor : sequence of int
        Output: dark frame plus baseline, shifted right by `shift` bits and rounded. `estimate`
        subtracts it.
    sums : sequence of int
        Six sums of counts over `samples` samples.
    samples : int
        Samples in the reading.
    dark : sequence of int
        Dark frame: six counts in Q12.
    shift : int
        Right shift from Q12 to the scale of `floor`.
    up, down : int
        The baseline moves by a part of its distance to the reading: 2**-`up` or 2**-`down`.
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
    """Interpolate the columns of a table linearly; constant beyond both ends.

    Parameters
    ----------
    knots : sequence of int
        Ascending arguments of the table.
    columns : tuple of sequences of int
        Columns of the table, with a value for each knot.
    at : int
        Argument at which to interpolate.
    found : sequence of int
        Output: one rounded value for each column.
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
        Calibration of the strip; without it, all values are 0.
    sums, dark : sequence of int
        Six sums of counts over `samples` samples, and six dark sums over `dark_samples` samples.
        ``sums * dark_samples`` and ``dark * samples`` must be at most 2**24.
    samples, dark_samples : int
        Samples in the reading and in the dark sums.
    scratch : sequence of int
        Work array with `SCRATCH` elements. If the position is known, element 2 is the misfit to
        one press and element 1 its tolerance, both in Q12.
    reading : sequence of int
        Output: contrast and brightness in Q20 of log2, position in um, force in mN. Unknown values
        are 0.

    Returns
    -------
    int
        1 if the light is too low for a position, else 0.
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
    scratch[2] = fit - scratch[1]
    look_up(calibration.brightnesses, calibration.columns, brightness, scratch)
    reading[3] = scratch[0]
    return 0


def _take_logs(sums, samples, dark, dark_samples, logs):
    for i in range(CHANNELS):
        net = sums[i] * dark_samples - samples * dark[i]
        if net <= 0:
            return False
        logs[i] = log2_q20(net)
    logs[CHANNELS] = log2_q20(samples * dark_samples)
    return True


def _dot(weights, logs):
    # Sum of weight (Q13) times logarithm (Q20), in Q20. The split keeps all values within 31 bits,
    # for logarithms below 2**25 and a sum of absolute weights of at most 2**16.
    high = low = 0
    for i in range(CHANNELS):
        weight = weights[i]
        log = logs[i]
        high += weight * (log >> 13)
        low += weight * (log & 8191)
    return high + (low >> 13)


def _below(bounds, value):
    # Return the last i with bounds[i] <= value, or 0.
    i = len(bounds) - 1
    while i > 0 and value < bounds[i]:
        i -= 1
    return i


def _crc_tables():
    # Tables of the CRC-32 of zlib, polynomial 0xEDB88320, in halves of 16 bits.
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
del _crc_tables  # frees memory on a board


def crc32(data, size, crc):
    """Update a CRC-32 with the first `size` bytes of `data`.

    Parameters
    ----------
    data : bytes-like
        Bytes to add.
    size : int
        Number of bytes to add.
    crc : array.array
        ``array("H")`` with the low and the high half of the state, changed in place. Both halves
        start as 0xFFFF. The CRC-32 is the complement of the state.
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
    """Encode the first `size` bytes of `source` with COBS into `target`, and add a zero byte.

    Returns the number of bytes in `target`, including the zero byte.
    """
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
    """Append the CRC to the first `size` bytes of `payload`, and encode both into `encoded`.

    `payload` must have room for `CRC_SIZE` more bytes. Returns the length of the frame in bytes.
    """
    crc = _crc
    crc[0] = crc[1] = 0xFFFF
    crc32(payload, size, crc)
    payload[size] = ~crc[0] & 0xFF
    payload[size + 1] = ~crc[0] >> 8 & 0xFF
    payload[size + 2] = ~crc[1] & 0xFF
    payload[size + 3] = ~crc[1] >> 8 & 0xFF
    return cobs_encode(payload, size + CRC_SIZE, encoded)
