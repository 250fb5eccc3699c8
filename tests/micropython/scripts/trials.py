"""The firmware's arithmetic on many cases; results go into arrays that exist before."""

from array import array

from canned import Clock
from spots_device import kernel
from spots_device.frame import Time32
from spots_device.keypad import Keypad
from spots_device.layout import Layout
from spots_device.locate import locate as locate_second
from spots_device.locate import power as power_of_two
from spots_device.log2 import log2_q20
from spots_device.pacing import Pacing

_BURST_US = 390
_CLEAR_US = 73

_encoded = bytearray(660)
_scratch = array("i", bytes(4 * kernel.SCRATCH))
_reading = array("i", bytes(4 * 4))
_found = array("i", bytes(4 * 3))
_clock = Clock()
_time = Time32(_clock)
_pacing = Pacing(_clock)


def log2(cases, results):
    for i in range(len(cases)):
        results[i] = log2_q20(cases[i])


class Made:
    """Stands where a calibration or a segment of one stands in the kernel."""


def prepare_estimate(cases):
    prepared = []
    for tables, readings in cases:
        made = Made()
        made.weights = _arrays(tables["weights"])
        made.bounds = array("i", tables["bounds"])
        made.brightnesses, *columns = _arrays(tables["forces"])
        made.columns = tuple(columns)
        made.segments = []
        for weights, knots in tables["segments"]:
            part = Made()
            part.weights = part.position, part.force = _arrays(weights)
            part.contrasts, *columns = _arrays(knots)
            part.columns = tuple(columns)
            made.segments.append(part)
        readings = [
            (samples, array("i", sums), array("i", dark)) for samples, sums, dark in readings
        ]
        prepared.append((made, readings))
    return prepared


def estimate(cases, results):
    at = 0
    for i in range(len(cases)):
        made = cases[i][0]
        readings = cases[i][1]
        for j in range(len(readings)):
            case = readings[j]
            dark = kernel.estimate(made, case[1], case[0], case[2], 4, _scratch, _reading)
            results[at] = dark
            for k in range(4):
                results[at + 1 + k] = _reading[k]
            for k in range(1, 3):
                results[at + 4 + k] = 0 if dark else _scratch[k]
            at += 7


def prepare_accumulate(cases):
    return [(array("i", sums), array("i", counts), samples) for sums, counts, samples in cases]


def accumulate(cases, results):
    for i in range(len(cases)):
        case = cases[i]
        kernel.accumulate(case[0], case[1], case[2])
        for j in range(6):
            results[6 * i + j] = case[0][j]


def prepare_table(cases):
    return [(array("i", knots), _arrays([values]), at) for knots, values, at in cases]


def table(cases, results):
    at = 0
    for i in range(len(cases)):
        case = cases[i]
        readings = case[2]
        for j in range(len(readings)):
            kernel.look_up(case[0], case[1], readings[j], _scratch)
            results[at] = _scratch[0]
            at += 1


def prepare_bytes(cases):
    # Room for a checksum.
    return [(bytearray(case + [0] * kernel.CRC_SIZE), len(case)) for case in cases]


prepare_crc32 = prepare_cobs = prepare_frame = prepare_bytes
_crc = array("H", (0, 0))


def crc32(cases, results):
    for i in range(len(cases)):
        case = cases[i]
        _crc[0] = _crc[1] = 0xFFFF
        kernel.crc32(case[0], case[1], _crc)
        results[2 * i] = _crc[0]
        results[2 * i + 1] = _crc[1]


def cobs(cases, results):
    width = len(results) // len(cases)
    for i in range(len(cases)):
        case = cases[i]
        _keep(kernel.cobs_encode(case[0], case[1], _encoded), i * width, results)


def frame(cases, results):
    width = len(results) // len(cases)
    for i in range(len(cases)):
        case = cases[i]
        _keep(kernel.frame(case[0], case[1], _encoded), i * width, results)


class Events:
    """Keeps key events where results are wanted: time, page and direction, usage, modifiers."""

    def __init__(self):
        self.results = None
        self.at = self.end = self.now = 0

    def begin(self, results, at, most):
        self.results = results
        self.at = at
        self.end = at + most
        self.now = 0

    def key(self, page, usage, modifiers, pressed):
        self._keep(page << 1 | (1 if pressed else 0), usage << 8 | modifiers)

    def stuck(self):
        self._keep(1, 0)

    def _keep(self, what, which):
        if self.at + 3 <= self.end:
            self.results[self.at] = self.now
            self.results[self.at + 1] = what
            self.results[self.at + 2] = which
            self.at += 3


def prepare_keypad(cases):
    prepared = []
    while cases:  # popped, as in compute.py: a case and its arrays do not both fit the heap
        lines, length_um, readings = cases.pop(0)
        events = Events()
        pad = Keypad(events)
        pad.set_layout(Layout(lines), length_um, 289)
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


def prepare_follow(cases):
    return [tuple(_arrays(case[:4])) + tuple(case[4:]) for case in cases]


def follow(cases, results):
    for i in range(len(cases)):
        case = cases[i]
        kernel.follow(case[0], case[1], case[2], case[4], case[3], case[5], case[6], case[7])
        for j in range(6):
            results[12 * i + j] = case[0][j]
            results[12 * i + 6 + j] = case[1][j]


def power(cases, results):
    for i in range(len(cases)):
        results[i] = power_of_two(cases[i])


def prepare_locate(cases):
    return _arrays(cases)


def locate(cases, results):
    for i in range(len(cases)):
        case = cases[i]
        _found[0] = _found[1] = _found[2] = 0
        is_there = locate_second(
            _found, case[0], case[1], case[2], case[3], case[4], case[5], case[6]
        )
        results[4 * i] = 1 if is_there else 0
        for j in range(3):
            results[4 * i + 1 + j] = _found[j] if is_there else 0


def _keep(size, at, results):
    results[at] = size
    for j in range(size):
        results[at + 1 + j] = _encoded[j]


def _arrays(rows):
    return tuple([array("i", row) for row in rows])


def time32(cases, results):
    for i in range(len(cases)):
        _time.set(cases[i])
        results[2 * i] = _time.high
        results[2 * i + 1] = _time.low


def pacing(cases, results):
    # A chip that samples on its own clock, and a board that polls it late; -1 is no sample.
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
