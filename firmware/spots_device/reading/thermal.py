"""Shifts the tables of a calibration with the temperature of the board.

Imported only for a calibration with the line ``temperature``, see warming.py.
"""

from .. import const
from .decode import BOUNDS

_Q = const(10)


class Thermal:
    """Shifts tables in place. `follow` allocates nothing.

    `range_mC` has the temperature to which `tables` belong, the lowest and the highest one, in
    units of 0.001 degrees Celsius. `change` is the change of the first elements of `tables` between
    these two, below 2**20.
    """

    def __init__(self, tables, range_mC, change):
        self._made, self._low, self._high = range_mC
        self._tables = tables
        self._change = change
        self._share = 0

    def follow(self, mC):
        """Shift the tables to a temperature in units of 0.001 degrees Celsius (int)."""
        share = (min(max(mC, self._low), self._high) - self._made << _Q) // (self._high - self._low)
        tables = self._tables
        change = self._change
        for i in range(BOUNDS, len(change)):
            one = change[i]
            if one:
                tables[i] += (one * share >> _Q) - (one * self._share >> _Q)
        self._share = share
