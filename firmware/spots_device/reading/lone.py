"""Distinguishes one finger from two that touch together, by the first readings of a touch.

The misfit rises with the distance of two presses, in first order with its square. At 20 mm and 10
ms, that is five standard deviations of its noise, but less than its tolerance, which allows for
drift. So `kernel.process` compares the misfit with that of recent touches; while a touch begins, a
reading fits only if two fingers are improbable.

Drift shifts the misfit of all presses by a straight line along the strip. LED and dye shift it
nearly equally everywhere, the filters of the sensor twice as much at one end. `learn` finds this
line. Two fingers must not teach it: while they press and lift, their position moves.

Each function runs a few times in a touch. All integers fit 31 bits; allocates nothing.
"""

from .. import const
from ..sensor.smux import CHANNELS
from . import decode as d

# Limit of the excess in standard deviations, squared, times `_ONE`: 1.6. One of fifteen touches of
# one finger exceeds it in its second reading, and is typed one reading later.
_LIMIT = const(10486)
_ONE = const(4096)  # a weight is this, divided by a variance
_EXCESS_MAX = const(127)  # Q12
# Variance of a count: rounding and noise of sample and dark frame, and shot noise. Q8.
_COUNT_Q8 = const(37)
_SHOT_LOG2 = const(8)
_RATIO_MAX = const(1023)
# Least variance of the misfit, Q12 squared: an LED that cools by 1 or 2 K in a dark frame.
_LEAST = const(3)
_LARGE = const(4095)  # Q12
_FALLEN = const(337_000)  # 0.8, as difference of brightness in Q20 of log2
# Touches after a jump of the drift in which every reading within the tolerance fits, because one
# touch does not show how the drift changes along the strip.
_FRESH = const(6)


def begin(state):
    """Start a touch."""
    state[d.DOUBT] = 0 if state[d.FRESH] else 1
    state[d.EXCESS] = state[d.WEIGHT] = state[d.JUMPED] = state[d.BEGUN_US] = 0
    state[d.LONE] = 1
    state[d.X_FIRM_UM] = -d.NONE


def ignore(state):
    """Learn and doubt nothing, while light that is no press shifts the misfit, too."""
    state[d.X_FIRM_UM] = -d.NONE
    state[d.LEARNS] = state[d.DOUBT] = 0
    state[d.FRESH] = max(state[d.FRESH], 1)


def move(state):
    """Start the mean of `MEAN` again, because the light moved, or with the first firm reading."""
    if state[d.X_FIRM_UM] != -d.NONE:
        state[d.LONE] = state[d.EXCESS] = state[d.WEIGHT] = 0
        if state[d.BEGUN_US] < d.MOVES_US and not state[d.FRESH]:
            state[d.DOUBT] = 2
    state[d.MEAN] = state[d.OFF_Q12] << 4
    state[d.TOLERANCE_FIRM] = state[d.TOLERANCE_Q12]


def is_doubtful(state, tables):
    """Return whether two fingers may have caused a reading in which `DOUBT` is not 0."""
    # The mean over this reading and the ones before, which count half as much each.
    weight = _weigh(state, tables)
    excess = min(max(state[d.OFF_Q12], -_EXCESS_MAX), _EXCESS_MAX) * weight
    state[d.EXCESS] = excess = excess + (state[d.EXCESS] >> 1)
    state[d.WEIGHT] = weight = weight + (state[d.WEIGHT] >> 1)
    if (
        excess > 0
        and (excess // weight) * (excess // weight) * weight > _LIMIT
        and not _is_lone(state)
    ):
        return True
    state[d.DOUBT] = 2 if state[d.DOUBT] == 1 else 0  # the first reading may be too faint
    return False


# At most 11 words in each call frame, see strip.py.


def _is_lone(state):
    # The light has fallen where it was: of two fingers, one lifts before the other. `PEAK` is that
    # of the last touch in the first reading.
    return (
        state[d.LONE]
        and state[d.BEGUN_US] > state[d.TAKEN] * state[d.EXPOSURE_US]
        and state[d.OFF_Q12] <= state[d.TOLERANCE_Q12]
        and state[d.BRIGHTNESS] < state[d.PEAK] - _FALLEN
    )


def _weigh(state, tables):
    state[d.FOUND] = 0
    for i in range(CHANNELS):
        _add_noise(state, tables, i)
    return _ONE // ((state[d.FOUND] >> 13) // state[d.SAMPLES] + _LEAST) or 1


def _add_noise(state, tables, i):
    # Add the part of a channel in the variance of the misfit to `FOUND`.
    net = state[d.SUMS + i] // state[d.SAMPLES] - state[d.FLOOR + i] // state[d.FLOOR_SAMPLES]
    if net < 1:
        net = 1
    ratio = (abs(tables[d.WEIGHTS + CHANNELS + i]) << 2) // net
    if ratio > _RATIO_MAX:
        ratio = _RATIO_MAX
    net = _COUNT_Q8 + (net >> _SHOT_LOG2)
    state[d.FOUND] += ratio * ratio * net


def learn(state):
    """End a touch: learn the drift of the misfit, if one finger caused the touch."""
    if state[d.X_FIRM_UM] == -d.NONE:
        return
    off = state[d.MEAN] + 8 >> 4
    tolerance = state[d.TOLERANCE_FIRM]
    if state[d.FRESH] == d.UNKNOWN and abs(off) <= tolerance:
        # The first touch after a start; of two fingers, one has lifted before the other.
        if state[d.LONE] and abs(off) > tolerance >> 2:
            _jump(state, off)
        elif abs(off) <= tolerance >> 2:
            state[d.FRESH] = 0
        return
    if not state[d.LONE]:
        if state[d.JUMPED]:
            _jump(state, -state[d.JUMPED])
            state[d.FRESH] = 0
        elif not state[d.DOUBT]:
            off = min(off + (tolerance >> 2), 0)  # two fingers only raise the misfit
            _follow_drift(state, off, tolerance)
            return
        state[d.SEEN] = d.NONE  # two fingers: what is seen next is no confirmation
        return
    agrees = _agrees(state, off, tolerance)
    state[d.SEEN] = off
    if abs(off) <= tolerance:
        # A few of a hundred touches of two fingers look like this, too.
        _follow_drift(state, off if agrees or not state[d.DOUBT] else off >> 1, tolerance)
    elif agrees:
        _jump(state, off)


def confirm(state):
    """Return `OFF_Q12`; before, learn a drift that the last touch has shown, too."""
    off = state[d.OFF_Q12]
    tolerance = state[d.TOLERANCE_Q12]
    if state[d.LONE] and abs(off) > tolerance and _agrees(state, off, tolerance):
        _jump(state, off)
        state[d.OFF_Q12] = off = off - state[d.JUMPED]
    return off


def _agrees(state, off, tolerance):
    # The last touch showed `off`, too, and not the known drift.
    away = abs(off - state[d.SEEN])
    return away <= tolerance and away <= abs(off) >> 1


def _jump(state, off):
    # The misfit of this touch is that of all: add `off` to the drift.
    limit = state[d.DRIFT_MAX]
    before = state[d.DRIFT]
    state[d.DRIFT] = min(max(before + off, -limit), limit)
    state[d.JUMPED] = state[d.DRIFT] - before
    state[d.FRESH] = _FRESH
    state[d.DOUBT] = 0


def _follow_drift(state, off, tolerance):
    # Normalised least mean squares; noisier touches count less.
    tolerance = min(tolerance, _LARGE) + 16
    off = min(max(off, -_LARGE), _LARGE)
    off = ((off << 8) + (tolerance << 3)) // tolerance  # Q4
    far = max(state[d.MIDDLE_UM] >> 10, 8)
    place = (state[d.X_FIRM_UM] >> 10) - far
    state[d.DRIFT] += off >> 4
    state[d.SLOPE] += ((off - 8) * place << 6) // (far * far)
    state[d.FRESH] = max(state[d.FRESH] - 1, 0)
