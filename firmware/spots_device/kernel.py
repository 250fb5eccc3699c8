"""Arithmetic and framing of a sample in portable Python.

These functions, from counts to framed bytes, take most of the processing time of a sample. Boards
with ``viper = true`` in board.toml get kernel_viper.py instead of this file: the same functions
with identical results, in machine code. All integers fit 31 bits; the functions allocate nothing.

On a board, every sequence of integers must be an ``array('i')``, because kernel_viper.py reads
the memory of these arrays directly.
"""

from array import array
from struct import pack_into

from .calibration import BOUNDS, FORCES, SEGMENTS, WEIGHTS
from .decode import (
    BRIGHTNESS,
    CONTRAST,
    CRC_SIZE,
    DRIFT_MAX,
    FLAGS,
    FLOOR_SAMPLES,
    FORCE_MN,
    GAP,
    HEADER_SIZE,
    KIND,
    LED_OFF,
    LIGHT,
    LOG_SAMPLES,
    MISFIT,
    NOT_CALIBRATED,
    POSITION_UM,
    SAMPLES,
    SEQUENCE,
    TOO_DARK,
    TOUCH_OFF_MN,
    TOUCH_ON_MN,
    TOUCHING,
)
from .log2 import log2_q20
from .smux import CHANNELS

# Elements of `state` that only this module uses, in addition to those in decode.py: drift of the
# misfit, see `_judge`; misfit to one press and its tolerance in Q12, if the position is known; six
# logarithms (Q20); up to three values that `look_up` returns.
DRIFT, LEARNS, SEEN = range(11, 14)
MISFIT_Q12, TOLERANCE_Q12 = 15, 16
LOGS, FOUND = 17, 27

TOUCH_BODY = "<BiiiH"  # flags, contrast, brightness, position_um, force_mN
TOUCH_SIZE = HEADER_SIZE + 15


def unpack(burst, counts, at):
    """Copy six little-endian counts from `burst`, byte `at` onwards; return the largest count."""
    most = 0
    for i in range(CHANNELS):
        count = burst[at] | burst[at + 1] << 8
        at += 2
        counts[i] = count
        if count > most:
            most = count
    return most


def accumulate(sums, counts, samples):
    """Add six counts to the sums of `samples` earlier samples; with 0 samples, start new sums."""
    if samples == 0:
        for i in range(CHANNELS):
            sums[i] = counts[i]
    else:
        for i in range(CHANNELS):
            sums[i] += counts[i]


def estimate(state, tables, sums, floor, flags):
    """Estimate flags, contrast, brightness, position and force of a reading.

    Parameters
    ----------
    state : sequence of int
        Settings (input) and estimates (output) at the indices that decode.py defines.
    tables : sequence of int
        Tables of the calibration, see `calibration.SEGMENTS`; 0 segments mean that there is no
        calibration.
    sums, floor : sequence of int
        `sums`: six sums of counts over ``state[SAMPLES]`` samples. `floor`: six sums of dark frame
        and baseline over ``state[FLOOR_SAMPLES]`` samples; subtracted after scaling. ``sums *
        state[FLOOR_SAMPLES]`` and ``floor * state[SAMPLES]`` must be at most 2**24.
    flags : int
        Flag bits that apply to `sums`: `decode.SATURATED`, `decode.DARK_SUBTRACTED`, `LED_OFF`.
    """
    touching = state[FLAGS] & TOUCHING
    for i in range(CONTRAST, FORCE_MN + 1):
        state[i] = 0
    if not tables[SEGMENTS]:
        flags |= NOT_CALIBRATED
    if flags & LED_OFF:
        # Without light a touch cannot be detected: the state of the touch does not change.
        state[FLAGS] = flags | touching
        return
    state[LIGHT] = sums[0] + sums[1] + sums[2] + sums[3] + sums[4] + sums[5]
    if not _take_logs(state, sums, floor):
        flags |= TOO_DARK
    elif tables[SEGMENTS]:
        flags |= _judge(state, touching) if _locate(state, tables) else TOO_DARK
    state[FLAGS] = flags


def _take_logs(state, sums, floor):
    for i in range(CHANNELS):
        net = sums[i] * state[FLOOR_SAMPLES] - state[SAMPLES] * floor[i]
        if net <= 0:
            return False
        state[LOGS + i] = log2_q20(net)
    return True


def _locate(state, tables):
    # Compute contrast, brightness, position, force, misfit; return whether the position is known.
    contrast = state[CONTRAST] = _dot(tables, WEIGHTS, state)
    misfit = _dot(tables, WEIGHTS + CHANNELS, state) >> 8
    place = BOUNDS + 2 * tables[SEGMENTS] - 2
    while place > BOUNDS and contrast < tables[place]:
        place -= 2
    place = tables[place + 1]
    contrast = _dot(tables, place, state)
    brightness = _dot(tables, place + CHANNELS, state) - state[LOG_SAMPLES]
    look_up(tables, place + 2 * CHANNELS, contrast, state, 3)
    brightness -= state[FOUND + 2]
    state[BRIGHTNESS] = brightness
    if brightness < tables[tables[FORCES] + 1]:
        return False
    state[POSITION_UM] = state[FOUND]
    state[MISFIT_Q12] = misfit - state[FOUND + 1]
    look_up(tables, tables[FORCES], brightness, state, 2)
    state[FORCE_MN] = state[FOUND]
    state[TOLERANCE_Q12] = state[FOUND + 1]
    return True


def _judge(state, touching):
    # Return the flags of a reading whose position is known.
    misfit = state[MISFIT_Q12]
    tolerance = state[TOLERANCE_Q12]
    flags = 0
    if abs(misfit) > tolerance:
        flags = MISFIT
        # A reading that fits one press up to the drift is untrusted, but good enough for a key, see
        # contact.TWO_FIT.
        if abs(misfit - state[DRIFT]) <= tolerance:
            flags |= TOO_DARK
    force_mN = state[FORCE_MN]
    least_mN = state[TOUCH_OFF_MN]
    if not touching:
        # A lamp or two fingers: light that fits no press begins a touch at the force from which
        # the drift is learned.
        least_mN = state[TOUCH_ON_MN] << (2 if flags == MISFIT else 0)
        state[LEARNS] = 3
    if not force_mN or force_mN < least_mN:
        return flags & MISFIT
    # Drift shifts the misfit of every press alike. A touch gives this shift in its third reading
    # with at least four times the force at which touches begin; in fainter readings the noise
    # exceeds most shifts. The shift is used if the previous touch gave the same shift: two fingers
    # seldom touch together twice in a row.
    if state[LEARNS] and force_mN >> 2 >= state[TOUCH_ON_MN]:
        state[LEARNS] -= 1
        if not state[LEARNS]:
            if abs(misfit - state[SEEN]) <= tolerance:
                state[DRIFT] = min(max(misfit, -state[DRIFT_MAX]), state[DRIFT_MAX])
            state[SEEN] = misfit
            return _judge(state, TOUCHING)  # with the new drift
    return flags | TOUCHING


def _dot(tables, first, state):
    # Sum of weight (Q13) times logarithm (Q20), in Q20. The split keeps all values within 31 bits,
    # for logarithms below 2**25 and a sum of absolute weights of at most 2**16.
    high = low = 0
    for i in range(CHANNELS):
        log = state[LOGS + i]
        high += tables[first + i] * (log >> 13)
        low += tables[first + i] * (log & 8191)
    return high + (low >> 13)


def look_up(tables, place, at, state, columns):
    """Interpolate the columns of a table linearly; beyond its ends, the end values apply.

    Parameters
    ----------
    tables : sequence of int
        Array that contains the table.
    place : int
        Index in `tables` at which the table begins: the number n of its knots, then the n knots
        (arguments), then n values for each column.
    at : int
        Argument at which to interpolate.
    state : sequence of int
        Output: one rounded value for each column, from index `FOUND` on.
    columns : int
        Number of columns.
    """
    size = tables[place]
    low = _knot_below(tables, place + 1, place + size, at)
    width = tables[low + 1] - tables[low]
    at = min(max(at - tables[low], 0), width)
    for column in range(FOUND, FOUND + columns):
        low += size
        state[column] = tables[low] + (at * (tables[low + 1] - tables[low]) + (width >> 1)) // width


def _knot_below(tables, low, high, at):
    while high - low > 1:
        middle = (low + high) >> 1
        if at < tables[middle]:
            high = middle
        else:
            low = middle
    return low


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
        ``array("H")`` with the low and the high half of the CRC register, changed in place. Both
        halves start as 0xFFFF. The CRC-32 is the complement of the register's last value.
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


def frame(head, payload, size, encoded):
    """Add header and CRC to a payload, and encode it with COBS; return the encoded length in bytes.

    Parameters
    ----------
    head : sequence of int
        Header, see `decode.KIND`. Its sequence number is increased by 1.
    payload : bytearray
        Contains the body after `HEADER_SIZE` bytes, and has room for `CRC_SIZE` bytes after it.
    size : int
        Number of bytes of header and body.
    encoded : bytearray
        Output: the encoded frame and its delimiter, a zero byte.
    """
    payload[0] = head[KIND]
    for i in range(SEQUENCE, GAP):
        payload[2 * i - 1] = head[i] & 0xFF
        payload[2 * i] = head[i] >> 8
    head[SEQUENCE] = (head[SEQUENCE] + 1) & 0xFFFF
    crc = _crc
    crc[0] = crc[1] = 0xFFFF
    crc32(payload, size, crc)
    payload[size] = ~crc[0] & 0xFF
    payload[size + 1] = ~crc[0] >> 8 & 0xFF
    payload[size + 2] = ~crc[1] & 0xFF
    payload[size + 3] = ~crc[1] >> 8 & 0xFF
    return cobs_encode(payload, size + CRC_SIZE, encoded)


def touch(head, payload, state, encoded):
    """Encode the reading in `state` as a TOUCH frame; other arguments and result as in `frame`."""
    pack_into(
        TOUCH_BODY,
        payload,
        HEADER_SIZE,
        state[FLAGS] | head[GAP],
        state[CONTRAST],
        state[BRIGHTNESS],
        state[POSITION_UM],
        state[FORCE_MN],
    )
    return frame(head, payload, TOUCH_SIZE, encoded)
