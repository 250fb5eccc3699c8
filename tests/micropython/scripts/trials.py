"""The firmware's arithmetic on many cases; each trial fills results that were made before it."""

from canned import Clock

from tactile import decode, frame
from tactile.log2 import log2_q20
from tactile.pacing import Pacing

_BURST_US = 390
_CLEAR_US = 73

_encoded = bytearray(520)
_clock = Clock()
_time = frame.Time32(_clock)
_pacing = Pacing(_clock)


def log2(cases, results):
    for i in range(len(cases)):
        results[i] = log2_q20(cases[i])


def dot(cases, results):
    for i in range(len(cases)):
        case = cases[i]
        results[i] = decode.dot(case[0], case[1])


def table(cases, results):
    at = 0
    for i in range(len(cases)):
        case = cases[i]
        knots = case[0]
        readings = case[2]
        for j in range(len(readings)):
            segment = decode.segment(knots, readings[j])
            results[at] = segment
            results[at + 1] = decode.interpolate(knots, case[1], segment, readings[j])
            at += 2


def crc16(cases, results):
    for i in range(len(cases)):
        results[i] = frame.crc16(cases[i], len(cases[i]))


def cobs(cases, results):
    width = len(results) // len(cases)
    for i in range(len(cases)):
        size = frame.cobs_encode(cases[i], len(cases[i]), _encoded)
        results[i * width] = size
        for j in range(size):
            results[i * width + 1 + j] = _encoded[j]


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
