"""Computes how the tables of a calibration change with the temperature; dropped after that.

The lines ``warm`` contain the changes of the channels at marks, between the lowest and the highest
temperature of several re-zeros. Between the marks, a change is a polynomial of the position, as in
spots/calibrate/fit/shift.py. Between the temperatures, it is linear. Beyond them, the tables are
those at the nearest one.
"""

from array import array

from .. import const
from ..sensor.smux import CHANNELS
from .decode import BOUNDS, FORCES, SEGMENTS, WEIGHTS
from .thermal import Thermal

_ONE_Q13 = const(1 << 13)  # of the weights, see `decode.WEIGHTS`
_CHANGE_MAX = const(1 << 20)
_Q12 = const(1 << 8)  # from Q20 to Q12
_MARKS_MAX = const(3)


def thermal_of(tables, range_mC, marks, check):
    """Return a `thermal.Thermal`, after a check of the tables at both ends of its range.

    `range_mC` is as there. Each of `marks` is a position in um, and six changes of log2 of the
    counts, Q20. `check` is `calibration_lines.check_table`. Invalid values, and those that would
    make the shifted tables invalid, raise a ValueError.
    """
    made, low, high = range_mC
    places = {mark[0] for mark in marks}
    if not (low <= made <= high > low and 0 < len(places) == len(marks) <= _MARKS_MAX):
        raise ValueError("'temperature' needs low <= made <= high, and 1 to 3 lines 'warm'")
    thermal = Thermal(tables, range_mC, _change(tables, marks))
    for mC in (high, low, made):
        thermal.follow(mC)
        for segment in range(tables[SEGMENTS]):
            _, table, size = _place(tables, segment)
            columns = range(0, 4 * size, size)
            knots = range(table, table + size)
            check("x", [[tables[knot + column] for column in columns] for knot in knots])
    return thermal


def _change(tables, marks):
    change = array("i", bytes(4 * tables[FORCES]))

    def add(at, weights, x_um, unit):
        # Store the change of a weighted sum at a position.
        total = 0.0
        for mark in marks:
            share = 1.0
            for other in marks:
                if other is not mark:
                    share *= (x_um - other[0]) / (mark[0] - other[0])
            for i in range(CHANNELS):
                total += share * mark[1 + i] * (tables[weights + i] / _ONE_Q13)
        if abs(total) >= _CHANGE_MAX:
            raise ValueError("the changes of 'warm' are too large: calibrate again")
        change[at] = round(total / unit)

    places = []
    segments = tables[SEGMENTS]
    for segment in range(segments):
        weights, table, size = _place(tables, segment)
        for knot in range(table, table + size):
            x_um = tables[knot + size]
            places.append(x_um)
            add(knot, weights, x_um, 1)
            add(knot + 2 * size, WEIGHTS + CHANNELS, x_um, _Q12)
            add(knot + 3 * size, weights + CHANNELS, x_um, 1)
    first = min(places)
    for segment in range(segments):
        border_um = first + (max(places) - first) * segment / segments
        add(BOUNDS + 2 * segment, WEIGHTS, border_um, 1)
    return change


def _place(tables, segment):
    # Indices of the weights of a segment and of its first knot, and the number of its knots.
    weights = tables[BOUNDS + 2 * segment + 1]
    table = weights + 2 * CHANNELS
    return weights, table + 1, tables[table]
