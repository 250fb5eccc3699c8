"""Arithmetic and framing of a sample in portable Python.

These functions, from counts to framed bytes, take most of the processing time of a sample. Boards
with ``viper = true`` in board.toml get kernel_viper.py instead of this file: `process` and `frame`
with identical results, in machine code. All integers fit 31 bits; the functions
allocate nothing.

On a board, the arguments of these two functions that are sequences of integers must be
``array('i')``, because kernel_viper.py reads the memory of these arrays directly.
"""

from array import array
from struct import pack_into

from ..sensor.smux import CHANNELS
from . import decode as d
from .log2 import GUARD, LIMIT, TABLE, Q
from .lone import begin, confirm, is_doubtful, learn, move
from .sticking import unstick

_ESTIMATES = "<iiiH"  # contrast, brightness, position_um, force_mN
TOUCH_BODY = "<B" + _ESTIMATES[1:]  # flags before them
_TOUCH = d.TOUCH_SIZE + d.CRC_SIZE
_TOUCH_COPY = "%ds" % _TOUCH


def process(work, flags):
    """Process a sample: add it to the reading, estimate the reading, and encode its TOUCH frame.

    `work` is a list at the indices that `decode` defines, see `decode.WORK_SIZE`. `flags` are flag
    bits of the sample, as for `estimate`. Returns the length of the encoded frame in bytes; 0 if
    there is no frame. After the call, the element `TAKEN` of the strip's state is 0 if the reading
    is complete, and `DUE` is 1 if a dark window must begin.

    The time of the header plus its `LESS_US` must be the end of the sample. If the reading is
    complete, the time of the header is set to the middle of the reading.
    """
    state = work[d.STATE]
    if not _add(state, work[d.COUNTS], flags):
        return 0
    estimate(state, work[d.TABLES], state[d.PENDING])
    flags = state[d.FLAGS]  # keys and contacts may change them
    _stamp(state, work[d.HEAD])
    use = work[d.USE]
    _follow_light(state, flags, use() if use else False)
    if not state[d.STREAMED]:
        return 0
    head = work[d.HEAD]
    head[d.KIND] = state[d.STREAMED]
    head[d.GAP] |= state[d.MISSING]
    state[d.MISSING] = 0
    put_touch(state, head, work[d.PAYLOAD])
    return frame(head, work[d.PAYLOAD], d.TOUCH_SIZE, work[d.ENCODED])


def put_touch(state, head, payload):
    """Write the body of the TOUCH frame of a reading."""
    payload[d.HEADER_SIZE] = state[d.FLAGS] | head[d.GAP]
    _put_estimates(state, payload)


def _put_estimates(state, payload):  # one call with all values would need the heap
    pack_into(
        _ESTIMATES,
        payload,
        d.HEADER_SIZE + 1,
        state[d.CONTRAST],
        state[d.BRIGHTNESS],
        state[d.POSITION_UM],
        state[d.FORCE_MN],
    )


def _add(state, counts, flags):
    # Add a sample to the reading; return whether the reading is complete.
    if state[d.TAKEN]:
        for i in range(CHANNELS):
            state[d.SUMS + i] += counts[i]
    else:
        # One line for each channel: a loop takes twice as long, here and in `estimate`.
        state[d.SUMS] = counts[0]
        state[d.SUMS + 1] = counts[1]
        state[d.SUMS + 2] = counts[2]
        state[d.SUMS + 3] = counts[3]
        state[d.SUMS + 4] = counts[4]
        state[d.SUMS + 5] = counts[5]
    state[d.TAKEN] += 1
    state[d.PENDING] |= flags
    if state[d.AGE_US] < state[d.EVERY_US]:
        state[d.AGE_US] += state[d.AGE_STEP_US]
    if state[d.TAKEN] < state[d.AVERAGE] and not flags & d.LED_OFF:
        state[d.DUE] = 1 if state[d.WANTED] else 0
        return False
    return True


def _stamp(state, head):
    # Set the time in the header to the middle of the reading.
    half_us = state[d.TAKEN] * state[d.EXPOSURE_US] >> 1
    low = head[d.TIME_LOW] + head[d.LESS_US] - half_us
    head[d.LESS_US] = half_us
    head[d.TIME_HIGH] = head[d.TIME_HIGH] + (low >> 16) & 0xFFFF
    head[d.TIME_LOW] = low & 0xFFFF


def _follow_light(state, flags, two):
    # End the reading: check the ambient light, track the baseline, determine `DUE`. `two` means
    # that two fingers may have caused the reading.
    lasted_us = state[d.TAKEN] * state[d.EXPOSURE_US]
    state[d.TAKEN] = state[d.PENDING] = 0
    if state[d.TOUCHED]:
        state[d.IDLE_US] = 0
    elif state[d.IDLE_US] < d.IDLE_US_MAX:
        state[d.IDLE_US] += lasted_us
    if not flags & d.NOT_CALIBRATED:  # without a calibration, the spectrum of a press is unknown
        # Readings of two fingers look like ambient light. They have less weight in the detection,
        # because a dark frame costs readings.
        _odd_light(state, flags, lasted_us >> 3 if two else lasted_us)
    if not flags & (d.LED_OFF | d.NOT_CALIBRATED) and (state[d.PEAK] or flags & d.TOUCHING):
        unstick(state, flags, lasted_us)
    aged = state[d.AGE_US] >= state[d.EVERY_US] and state[d.IDLE_US] >= state[d.IDLE_MIN_US]
    if state[d.TOUCHED] and state[d.BEGUN_US] >= d.SHADED_US:
        aged |= state[d.AGE_US] >= state[d.SHADE_US]
    state[d.DUE] = 1 if state[d.WANTED] or aged else 0


def _odd_light(state, flags, lasted_us):
    # Request a dark frame if the ambient light has changed since the last one, see dark.py.
    if flags & (d.TOUCHING | d.LED_OFF):
        odd = flags & d.MISFIT
    else:
        level = state[d.LIGHT] // state[d.SAMPLES] + 1 - (state[d.STUCK] >> 8)
        if not state[d.LEVEL]:
            _expect(state)
        odd = abs(level - state[d.LEVEL]) > d.ODD_COUNTS
    if not odd:
        state[d.ODD_US] = 0
    elif state[d.ODD_US] < d.ODD_US_MAX:
        state[d.ODD_US] += lasted_us << d.BELOW_SHIFT if state[d.BELOW] else lasted_us
    elif state[d.AGE_US] >= d.ODD_EVERY_US:
        state[d.WANTED] |= d.CHECK if state[d.AGE_STEP_US] else 0


def _expect(state):
    # A function of its own, because `_odd_light` would need more than 11 words with these lines.
    floor = 0
    for i in range(d.FLOOR, d.FLOOR + CHANNELS):
        floor += state[i]
    state[d.LEVEL] = floor // state[d.FLOOR_SAMPLES] + 1
    if state[d.STUCK] >= d.STUCK_LEAST:
        state[d.LEVEL] -= state[d.STUCK] >> 8


def estimate(state, tables, flags):
    """Estimate flags, contrast, brightness, position and force of a reading.

    `flags` are those that apply to the sums: `decode.SATURATED`, `DARK_SUBTRACTED`, `LED_OFF`. The
    six sums at `SUMS` are over ``state[SAMPLES]`` samples; those at `FLOOR`, of dark frame and
    baseline, are over ``state[FLOOR_SAMPLES]`` samples and subtracted after scaling. ``sums *
    state[FLOOR_SAMPLES]`` and ``floor * state[SAMPLES]`` must be at most 2**24, the limit of
    `log2.log2_q20`.
    """
    touching = state[d.TOUCHED]
    state[d.CONTRAST] = state[d.BRIGHTNESS] = state[d.POSITION_UM] = state[d.FORCE_MN] = 0
    if not tables[d.SEGMENTS]:
        flags |= d.NOT_CALIBRATED
    if flags & d.LED_OFF:
        # Without light a touch cannot be detected: the state of the touch does not change.
        state[d.FLAGS] = flags
        return
    light = state[d.SUMS] + state[d.SUMS + 1] + state[d.SUMS + 2]
    state[d.LIGHT] = light + state[d.SUMS + 3] + state[d.SUMS + 4] + state[d.SUMS + 5]
    if not _take_logs(state):
        if touching and not flags & d.NOT_CALIBRATED and _has_faded(state):
            state[d.WANTED] |= d.CHECK
            state[d.FLAGS] = flags | d.MISFIT | d.TOUCHING
            return
        flags |= d.TOO_DARK
    elif tables[d.SEGMENTS]:
        flags |= _touch_flags(state, touching) if _locate(state, tables) else d.TOO_DARK
    state[d.TOUCHED] = flags & d.TOUCHING
    if flags & d.TOUCHING:
        _follow_touch(state, touching)
        if state[d.DOUBT] and is_doubtful(state, tables):
            flags = (flags | d.TOO_DARK | d.MISFIT) ^ d.TOO_DARK
    elif touching:
        learn(state)
    state[d.FLAGS] = flags


def _has_faded(state):
    # A finger that lifts leaves no light below the floor: until a dark window has shown the ambient
    # light, the finger has not left. Light that sticks is only estimated, so a floor with such
    # light shows nothing. If the window changes nothing, the next reading ends the touch.
    state[d.FAINT] = (
        1
        if state[d.BELOW]
        and not state[d.FAINT]
        and state[d.AGE_STEP_US]
        and state[d.STUCK] < d.STUCK_LEAST
        else 0
    )
    return state[d.FAINT]


def _size_table():
    # Number of bits of each byte.
    sizes = bytearray(256)
    for byte in range(1, 256):
        sizes[byte] = sizes[byte >> 1] + 1
    return sizes


_SIZES = _size_table()
del _size_table  # frees memory on a board


def _take_logs(state):
    # Computes `log2.log2_q20` without calls: 60 us for each logarithm instead of 75 us on an RP2040
    # with CircuitPython.
    state[d.BELOW] = 0
    for i in range(d.LOGS, d.LOGS + CHANNELS):
        net = state[i + d.FLOOR - d.LOGS] * state[d.SAMPLES]
        net = state[i + d.SUMS - d.LOGS] * state[d.FLOOR_SAMPLES] - net
        if net <= 0:
            log = state[d.SAMPLES] * state[d.FLOOR_SAMPLES]
            net += d.BELOW_COUNTS * log
            if net < 0:
                state[d.BELOW] = 1
            return False
        if net >= LIMIT:
            state[i] = 24 << Q
            continue
        log = 15 << Q
        if net < 1 << 16:
            net <<= 8
            log = 7 << Q
            if net < 1 << 16:
                net <<= 8
                log = -1 << Q
        low = _SIZES[net >> 16]
        net <<= 8 - low  # it has 24 bits now
        log += low << Q
        low = TABLE[(net >> 14) - 512]
        step = TABLE[(net >> 14) - 511] - low
        low += (net & 16383) * step >> 14
        state[i] = log + (low + 8 >> GUARD)
    return True


def _locate(state, tables):
    # Compute contrast, brightness, position, force, misfit; return whether the position is known.
    _dots(tables, d.WEIGHTS, state)
    state[d.CONTRAST] = state[d.FOUND]
    misfit = state[d.FOUND + 1] >> 8
    place = d.BOUNDS + 2 * tables[d.SEGMENTS] - 2
    while place > d.BOUNDS and state[d.CONTRAST] < tables[place]:
        place -= 2
    place = tables[place + 1]
    _dots(tables, place, state)
    brightness = state[d.FOUND + 1] - state[d.LOG_SAMPLES]
    place += 2 * CHANNELS
    state[d.BEYOND] = _beyond(tables, place, state[d.FOUND])
    look_up(tables, place, state[d.FOUND], state, 3)
    brightness -= state[d.FOUND + 2]
    state[d.BRIGHTNESS] = brightness
    if brightness < tables[tables[d.FORCES] + 1]:
        return False
    state[d.POSITION_UM] = state[d.FOUND]
    state[d.MISFIT_Q12] = misfit - state[d.FOUND + 1]
    look_up(tables, tables[d.FORCES], brightness, state, 2)
    state[d.FORCE_MN] = state[d.FOUND]
    state[d.TOLERANCE_Q12] = state[d.FOUND + 1]
    if tables[d.CROSS]:
        _cross(tables, state)
    if brightness > tables[tables[d.FORCES] + tables[tables[d.FORCES]]] + d.BEYOND_Q20:
        state[d.BEYOND] = d.TOO_DARK
    return True


def _beyond(tables, place, at):
    # Return `TOO_DARK` if the argument `at` of a table of positions is beyond the table's ends by
    # more than half the distance of two knots; else 0. With the cross-sensitivity, return how far
    # it is beyond, in um for `_cross`; `OUTSIDE_UM` for more than the distance of two knots.
    low = place + 1
    high = place + tables[place]
    if at < tables[low]:
        at -= tables[low]
    elif at > tables[high]:
        low = high - 1
        at -= tables[high]
    else:
        return 0
    width = tables[low + 1] - tables[low]
    if not tables[d.CROSS]:
        return d.TOO_DARK if abs(at) > width >> 1 else 0
    low += tables[place]
    if abs(at) > width:
        return d.OUTSIDE_UM if (tables[low + 1] > tables[low]) == (at > 0) else -d.OUTSIDE_UM
    return at * (tables[low + 1] - tables[low]) // width


def _cross(tables, state):
    # Correct position, misfit and `BEYOND` for the cross-sensitivity.
    share = state[d.FOUND + 2]
    state[d.MISFIT_Q12] -= state[d.FOUND + 4] * share >> 12
    at = state[d.POSITION_UM] + state[d.BEYOND] + (state[d.FOUND + 3] * share >> 12)
    end = tables[d.CROSS]
    far = end >> d.FAR_LOG2
    state[d.BEYOND] = d.TOO_DARK if at < -far or at > end + far else 0
    if at < 0:
        at = 0
    elif at > end:
        at = end
    state[d.POSITION_UM] = at


def _touch_flags(state, touching):
    # Return the flags of a reading whose position is known.
    tolerance = state[d.TOLERANCE_Q12]
    off = _off(state)
    state[d.OFF_Q12] = off
    off = abs(off)
    flags = 0
    if abs(state[d.MISFIT_Q12]) > tolerance:
        flags = d.MISFIT
        # A reading that fits one press after subtraction of the drift is untrusted, but good enough
        # for a key, see decode.FITS_WITH_DRIFT.
        if off <= tolerance:
            flags |= d.TOO_DARK
        elif off > d.ALIEN * tolerance:
            # A lamp was switched on: measure it under the finger. If the LED is always on, nobody
            # can, and this light may remain after the lift: it is no touch.
            if state[d.AGE_STEP_US]:
                if touching and state[d.AGE_US] >= d.ODD_US_MAX:
                    state[d.WANTED] |= d.CHECK
            elif off - d.ALIEN * tolerance > state[d.DRIFT_MAX]:
                state[d.FAINT] = 0
                return flags
    force_mN = state[d.FORCE_MN]
    least_mN = state[d.TOUCH_OFF_MN]
    if not touching:
        least_mN = state[d.TOUCH_ON_MN]
        if flags == d.MISFIT:
            # The light fits no press, so it may be a lamp or two fingers. It begins a touch only at
            # the force from which the drift is learned, and only if it remains after a dark window.
            least_mN <<= 2
            if force_mN >= least_mN and state[d.LEVEL] and state[d.AGE_STEP_US]:
                state[d.WANTED] |= d.CHECK
                return flags
        state[d.LEARNS] = 3
    if not force_mN or force_mN < least_mN:
        state[d.FAINT] = 0
        return flags & d.MISFIT
    # A touch shows in its third reading with at least four times the force at which touches begin
    # that the strip has drifted, if the touch before showed the same drift. In fainter readings the
    # noise exceeds most drifts.
    if state[d.LEARNS] and force_mN >> 2 >= state[d.TOUCH_ON_MN]:
        state[d.LEARNS] -= 1
        if not state[d.LEARNS] and abs(confirm(state)) < off:
            return _touch_flags(state, d.TOUCHING)  # with the new drift
    if not touching or state[d.BRIGHTNESS] >= state[d.PEAK] - d.LEFT:
        state[d.FAINT] = 0
    elif state[d.FAINT]:
        state[d.FAINT] = 0
        return flags & d.MISFIT
    else:
        state[d.FAINT] = 1  # the touch ends at the second reading: another finger may be arriving
    return (flags or state[d.BEYOND]) | d.TOUCHING


def _off(state):
    # Misfit minus drift, at the position of the reading.
    place = state[d.POSITION_UM] - state[d.MIDDLE_UM] >> 10
    off = state[d.MISFIT_Q12] - state[d.DRIFT] - (state[d.SLOPE] * place >> 10)
    return min(max(off, -d.OFF_MAX), d.OFF_MAX)


def _follow_touch(state, touching):
    # Update what lone.py needs.
    if not touching:
        begin(state)
    if state[d.BEGUN_US] < d.BEGUN_US_MAX:
        state[d.BEGUN_US] += state[d.TAKEN] * state[d.EXPOSURE_US]
    if state[d.FORCE_MN] >> 2 >= state[d.TOUCH_ON_MN]:
        x_um = state[d.POSITION_UM]
        if abs(x_um - state[d.X_FIRM_UM]) > d.MOVED_UM:
            move(state)
        state[d.MEAN] += (state[d.OFF_Q12] << 4) - state[d.MEAN] >> 2
        state[d.X_FIRM_UM] = x_um
        state[d.TOLERANCE_FIRM] = min(state[d.TOLERANCE_FIRM], state[d.TOLERANCE_Q12])


def _dots(tables, first, state):
    # Two sums of weight (Q13) times logarithm (Q20), in Q20, from index `FOUND` on; the weights of
    # the second sum follow those of the first one. The split keeps all values within 31 bits, for
    # logarithms below 2**25 and a sum of absolute weights of at most 2**16.
    high = low = other_high = other_low = 0
    for i in range(d.LOGS, d.LOGS + CHANNELS):
        fine = state[i]
        coarse = fine >> 13
        fine &= 8191
        weight = tables[first]
        high += weight * coarse
        low += weight * fine
        weight = tables[first + CHANNELS]
        other_high += weight * coarse
        other_low += weight * fine
        first += 1
    state[d.FOUND] = high + (low >> 13)
    state[d.FOUND + 1] = other_high + (other_low >> 13)


def look_up(tables, place, at, state, columns):
    """Interpolate the columns of a table at `at`; beyond its ends, the end values apply.

    At the index `place` of `tables` is the number n of knots, then their n ascending arguments,
    then n values for each column. `columns` does not count those of the cross-sensitivity: 3 for
    positions, 2 for forces. The state gets one rounded value for each column, from the index
    `FOUND` on.
    """
    size = tables[place]
    low = place + 1
    high = place + size
    while high - low > 1:  # the binary search of the knot below `at`
        middle = low + high >> 1
        if at < tables[middle]:
            high = middle
        else:
            low = middle
    width = tables[low + 1] - tables[low]
    at -= tables[low]
    if at < 0:
        at = 0
    elif at > width:
        at = width
    half = width >> 1
    if tables[d.CROSS]:
        columns += columns - 1
    for column in range(d.FOUND, d.FOUND + columns):
        low += size
        middle = tables[low]
        state[column] = middle + (at * (tables[low + 1] - middle) + half) // width


def _crc_tables():
    # Tables of the CRC-32 of zlib, polynomial 0xEDB88320: the low 24 bits, and the high 8 bits.
    lows = array("i", bytes(1024))
    highs = bytearray(256)
    for byte in range(256):
        low = byte
        high = 0
        for _ in range(8):
            odd = low & 1
            low = (low >> 1 | high << 23 & 0x800000) ^ (0xB88320 if odd else 0)
            high = high >> 1 ^ (0xED if odd else 0)
        lows[byte] = low
        highs[byte] = high
    return lows, highs


_LOWS, _HIGHS = _crc_tables()
del _crc_tables  # frees memory on a board


def add_crc(data, size):
    """Write the CRC-32 of the first `size` bytes of `data` after them; CircuitPython has its own.

    A look-up of `_HIGHS` costs less than a larger call frame, which would need heap.
    """
    lows = _LOWS
    low = 0xFFFFFF
    high = 0xFF
    for i in range(size):
        i = (low ^ data[i]) & 0xFF
        low = (low >> 8 | high << 16) ^ lows[i]
        high = _HIGHS[i]
    data[size] = ~low & 0xFF
    data[size + 1] = ~low >> 8 & 0xFF
    data[size + 2] = ~low >> 16 & 0xFF
    data[size + 3] = ~high & 0xFF


def cobs_encode(source, size, target):
    """Encode the first `size` bytes of `source` with COBS into `target`, and add a zero byte.

    Returns the number of bytes in `target`, including the zero byte. Does not change the bytes
    after these: a port may have set them to zero, see `runtime/micropython.py`.
    """
    code_at = 0
    if size == _TOUCH:  # a copy in which distances replace the zero bytes takes half the time
        pack_into(_TOUCH_COPY, target, 1, source)
        for write in range(1, size + 1):
            if not target[write]:
                target[code_at] = write - code_at
                code_at = write
        write = size + 1
    else:
        write = 1
        for read in range(size):
            target[write] = source[read]
            if target[write]:
                write += 1
                if write - code_at < 255:
                    continue
            target[code_at] = write - code_at
            code_at = write
            write += 1
    target[code_at] = write - code_at
    target[write] = 0
    return write + 1


def _put_header(head, payload):
    pack_into(
        "<BHHH", payload, 0, head[d.KIND], head[d.SEQUENCE], head[d.TIME_LOW], head[d.TIME_HIGH]
    )
    head[d.SEQUENCE] = (head[d.SEQUENCE] + 1) & 0xFFFF


def frame(head, payload, size, encoded):
    """Add header and CRC to a payload, and encode it with COBS; return the encoded length.

    The payload has the body after `HEADER_SIZE` bytes, and room for `CRC_SIZE` bytes after its
    `size` bytes of header and body. The sequence number in `head` (see `decode.KIND`) is increased
    by 1.

    The delimiter of frames is a zero byte. An encoded frame must not fill its last USB packet of 64
    bytes exactly, because USB CDC then stalls. Such a frame gets a second delimiter; the host skips
    the empty frame between the two.
    """
    _put_header(head, payload)
    add_crc(payload, size)
    size = cobs_encode(payload, size + d.CRC_SIZE, encoded)
    if size + (1 if head[d.GAP] else 0) & 63 == 0:
        encoded[size] = 0
        size += 1
    return size
