"""Trials: functions of the firmware, each called for many cases.

A trial is a function ``trial(cases, results)`` that stores its results in the array `results`. A
function ``prepare_NAME`` converts the cases for the trial NAME before the heap is locked.
"""

from array import array

from canned import Clock
from spots_device.fingers import state as c
from spots_device.fingers.locate import estimate as estimate_second
from spots_device.fingers.locate import power as power_of_two
from spots_device.fingers.steady import stays
from spots_device.reading import decode as d
from spots_device.reading import kernel, sticking
from spots_device.reading.calibration_lines import pack
from spots_device.reading.decode import Decode
from spots_device.reading.frame import Time32
from spots_device.reading.log2 import log2_q20
from spots_device.sensor.burst import unpack as unpack_burst
from spots_device.sensor.pacing import Pacing

_BURST_US = 390
_CLEAR_US = 73

_encoded = bytearray(920)
_COMPARED = 20  # elements of a state, up to the slope of the drift
_decode = Decode()
_decode.scale(1, 4)
_head = array("i", bytes(4 * d.HEAD_SIZE))
_payload = bytearray(64)
_work = [None] * d.WORK_SIZE
_work[d.HEAD] = _head
_work[d.PAYLOAD] = _payload
_work[d.ENCODED] = _encoded
_tracked = array("i", bytes(4 * c.SIZE))
_clock = Clock()
_time = Time32(_clock)
_pacing = Pacing(_clock)


def log2(cases, results):
    for i in range(len(cases)):
        results[i] = log2_q20(cases[i])


def prepare_estimate(cases):
    prepared = []
    for tables, limits, checked, readings in cases:
        decode = Decode()
        decode.state[d.LEVEL], decode.state[d.AGE_STEP_US] = checked
        decode.state[d.TOUCH_ON_MN], decode.state[d.TOUCH_OFF_MN], decode.state[d.DRIFT_MAX] = (
            limits
        )
        decode.tables = pack(*tables)
        readings = [
            (samples, array("i", sums), array("i", floor), flags)
            for samples, sums, floor, flags in readings
        ]
        prepared.append((decode, readings))
    return prepared


def _estimate(state, tables, sums, floor, flags):
    level = state[d.LEVEL]
    state[d.TAKEN] = state[d.PENDING] = 0
    for i in range(6):
        state[d.FLOOR + i] = floor[i]
    _process(state, tables, sums, flags)
    state[d.LEVEL] = level


def _process(state, tables, counts, flags):
    _work[d.STATE] = state
    _work[d.TABLES] = tables
    _work[d.COUNTS] = counts
    return kernel.process(_work, flags)


def estimate(cases, results):
    at = 0
    for i in range(len(cases)):
        decode = cases[i][0]
        readings = cases[i][1]
        for j in range(len(readings)):
            case = readings[j]
            decode.scale(case[0], 4)
            _estimate(decode.state, decode.tables, case[1], case[2], case[3])
            for k in range(_COMPARED):
                results[at] = decode.state[k]
                at += 1
            results[at] = decode.state[d.WANTED]
            at += 1
            for k in range(d.STICK, d.STATE_SIZE):
                if k != d.BEYOND:  # only in portable code
                    results[at] = decode.state[k]
                    at += 1


def prepare_unstick(cases):
    return [(array("i", state), flags, lasted_us) for state, flags, lasted_us in cases]


def unstick(cases, results):
    at = 0
    for i in range(len(cases)):
        state, flags, lasted_us = cases[i]
        sticking.unstick(state, flags, lasted_us)
        for k in range(d.FLOOR, d.STATE_SIZE):
            results[at] = state[k]
            at += 1


def prepare_unpack(cases):
    return [(bytes(burst), array("i", bytes(24))) for burst in cases]


def unpack(cases, results):
    for i in range(len(cases)):
        burst, counts = cases[i]
        results[7 * i] = unpack_burst(burst, counts, 2)
        for j in range(6):
            results[7 * i + 1 + j] = counts[j]


def prepare_accumulate(cases):
    prepared = []
    for sums, counts, samples in cases:
        state = Decode().state
        state[d.AVERAGE] = samples + 2
        state[d.TAKEN] = samples
        for i in range(6):
            state[d.SUMS + i] = sums[i]
        prepared.append((state, array("i", counts)))
    return prepared


def accumulate(cases, results):
    for i in range(len(cases)):
        case = cases[i]
        _process(case[0], _decode.tables, case[1], 0)
        for j in range(6):
            results[6 * i + j] = case[0][d.SUMS + j]


_AT = 2 << 20  # contrast of one count, with the weights below
_ONE = array("i", (1,) * 6)
_NO_FLOOR = array("i", bytes(24))


def prepare_table(cases):
    prepared = []
    for knots, values, at in cases:
        rows = [(knots[i], values[i], values[i], 0) for i in range(len(knots))]
        forces = (-(1 << 28), 0, 0), (1 << 28, 0, 0)
        tables = pack([0] * 12, [0], [[8192] + [0] * 11], [rows], forces)
        prepared.append((tables, len(knots), at))
    return prepared


def table(cases, results):
    # The contrast of all cases is `_AT`, so the knots are shifted instead.
    place = 0
    for i in range(len(cases)):
        tables, size, readings = cases[i]
        first = tables[d.BOUNDS + 1] + 13
        moved = 0
        for j in range(len(readings)):
            for k in range(size):
                tables[first + k] += _AT - readings[j] - moved
            moved = _AT - readings[j]
            _estimate(_decode.state, tables, _ONE, _NO_FLOOR, 0)
            results[place] = _decode.state[d.POSITION_UM]
            place += 1


def prepare_frame(cases):
    # Room for header and checksum.
    return [(bytearray([0] * d.HEADER_SIZE + case + [0] * d.CRC_SIZE), len(case)) for case in cases]


def frame(cases, results):
    width = len(results) // len(cases)
    for i in range(len(cases)):
        case = cases[i]
        for j in range(d.HEAD_SIZE):
            _head[j] = 255 - 50 * j if i & 1 else 65_535 * (j > 0)
        length = kernel.frame(_head, case[0], d.HEADER_SIZE + case[1], _encoded)
        results[i * width] = _head[d.SEQUENCE]
        _keep(length, i * width + 1, results)


def prepare_touch(cases):
    return list(_arrays(cases))


def touch(cases, results):
    # The reading is that of a key engine, which may change it before its frame is encoded.
    width = len(results) // len(cases)
    _decode.state[d.STREAMED] = 1
    _work[d.USE] = _replace
    for i in range(len(cases)):
        _head[d.GAP] = 32 * (i & 1)
        _replacement[0] = cases[i]
        _keep(_process(_decode.state, _decode.tables, _ONE, 0), i * width, results)
    _work[d.USE] = None
    _decode.state[d.STREAMED] = 0


_replacement = [None]


def _replace():
    for j in range(5):
        _decode.state[j] = _replacement[0][j]
    return False


class Events:
    """Receiver of key events; stores time, page and direction, usage, and modifiers of each."""

    def __init__(self):
        self.results = None
        self.at = self.end = self.now = 0

    def begin(self, results, at, most):
        self.results = results
        self.at = at
        self.end = at + most
        self.now = 0

    def usage(self, page, usage, modifiers, pressed):
        pass

    def key(self, page, usage, modifiers, pressed):
        self._keep(page << 1 | (1 if pressed else 0), usage << 8 | modifiers)

    def has_room(self):
        return True

    def stuck(self):
        self._keep(1, 0)

    def _keep(self, what, which):
        if self.at + 3 <= self.end:
            self.results[self.at] = self.now
            self.results[self.at + 1] = what
            self.results[self.at + 2] = which
            self.at += 3


def prepare_keypad(cases):
    # Not at the top: other trials need the memory.
    from spots_device.keys.keypad import Keypad
    from spots_device.keys.layout import parse
    from spots_device.keys.merge import Merger

    prepared = []
    while cases:  # popped, as in compute.py: the heap has no room for a case and its arrays
        lines, length_um, readings = cases.pop(0)
        events = Events()
        pad = Keypad(events, Merger())
        pad.set_layout(parse(lines), length_um, 289)
        values = array("i", bytes(20 * len(readings)))
        while readings:
            at = 5 * len(readings) - 5
            values[at : at + 5] = array("i", readings.pop())
        prepared.append((pad, events, values))
    return prepared


def keypad(cases, results):
    width = len(results) // len(cases)
    for i in range(len(cases)):
        case = cases[i]
        pad = case[0]
        events = case[1]
        readings = case[2]
        events.begin(results, i * width, width)
        for j in range(0, len(readings), 5):
            events.now = t = readings[j + 4]
            pad.take(readings[j], readings[j + 1], readings[j + 2], readings[j + 3], t)
            pad.tick(t)
        pad.release()


def _keep(size, at, results):
    results[at] = size
    for j in range(size):
        results[at + 1 + j] = _encoded[j]


def _arrays(rows):
    return tuple([array("i", row) for row in rows])


def time32(cases, results):
    for i in range(len(cases)):
        _time.set(cases[i])
        results[2 * i] = _time.head[d.TIME_HIGH]
        results[2 * i + 1] = _time.head[d.TIME_LOW]


def pacing(cases, results):
    # A chip samples on its own clock, and a board polls it late. The result -1 means no sample.
    at = 0
    for i in range(len(cases)):
        case = cases[i]
        true_us = case[1]
        lateness_us = case[3]
        ends = _clock.ticks_add(case[2], true_us)
        _pacing.start(case[2], case[0])
        for j in range(len(lateness_us)):
            now = _clock.ticks_add(_pacing.due, lateness_us[j])
            results[at] = -1
            past_us = _clock.ticks_diff(now, ends)
            if past_us < 0:
                _pacing.early(now)
            else:
                ends = _clock.ticks_add(ends, (past_us // true_us + 1) * true_us)
                complete = _pacing.found(now, _clock.ticks_add(now, _BURST_US + _CLEAR_US))
                if complete is not None:
                    results[at] = complete
            results[at + 1] = _pacing.due
            results[at + 2] = _pacing.period_us
            results[at + 3] = _pacing.missed
            at += 4


def power(cases, results):
    for i in range(len(cases)):
        results[i] = power_of_two(cases[i])


def prepare_still(cases):
    return _arrays(cases)


def still(cases, results):
    s = _tracked
    width = c.SIZE + 1
    for i in range(len(cases)):
        case = cases[i]
        for j in range(c.SIZE):
            s[j] = case[1 + j]
        results[i * width] = 1 if stays(s, case[0]) else 0
        for j in range(c.SIZE):
            results[i * width + 1 + j] = s[j]


def prepare_second_finger(cases):
    return _arrays(cases)


def second_finger(cases, results):
    s = _tracked
    for i in range(len(cases)):
        case = cases[i]
        s[c.FOUND_UM] = s[c.FOUND_SLACK_UM] = s[c.FOUND_B] = 0
        s[c.LENGTH_UM] = case[0]
        s[c.DECAY] = case[1]
        s[c.NOISE_PRODUCT] = case[2]
        s[c.DRIFTS] = case[3]
        s[c.X_NOW_UM] = case[6]
        s[c.B_NOW] = case[7]
        is_there = estimate_second(s, case[4], case[5], case[8])
        results[4 * i] = 1 if is_there else 0
        for j in range(3):
            results[4 * i + 1 + j] = s[c.FOUND_UM + j]
