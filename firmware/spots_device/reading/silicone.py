"""Compensates hysteresis and creep of the silicone, which change the light at a given force.

Hysteresis is a weighted sum of play operators (Prandtl-Ishlinskii). Only its difference from a
first load (a force that has only grown since the finger touched) is subtracted, because the force
table was measured with first loads. Creep has three parts, each a low-pass filter of the force; a
share of each part is subtracted. The play operators restart when the finger lifts or moves to
another position. Creep restarts only when another position is pressed; after a lift it decays with
its time constants. All integers fit 31 bits; `take` allocates nothing.
"""

from array import array

from .. import const
from . import decode as d

_PARTS = const(3)  # play operators, and parts of the creep
_WEIGHTS_MAX = const((1 << 14) - 1)  # limit of the sum of weights, so that 65 N fits 31 bits
# A press is at another position if it is farther away than `_APART_UM`. Tested only above
# `_SURE_MN`, where the position has little noise.
_APART_UM = const(8000)
_SURE_MN = const(400)
_TIME_MASK = const((1 << 22) - 1)  # ticks as in tracker.py
# Creep is updated when at least `_LEAST_T` ticks have passed, in steps of at most `_STEP_T` ticks,
# so that products fit 31 bits. A longer time than `_LONGEST_T` counts as `_LONGEST_T`.
_LEAST_T = const(16)
_STEP_T = const(256)
_LONGEST_T = const(1 << 14)


class Compensation:
    """Corrects the force of one finger for hysteresis and creep of the silicone.

    The 13 integers in `values` are those of the line ``silicone``: factor of the force (Q12); half
    widths of three play operators in mN, their three weights (Q12); time constants of three parts
    of the creep in ms, their three shares of the force (Q12). Out of range, they raise a
    ValueError.
    """

    def __init__(self, values):
        self._values = array("i", values)
        total = values[0]
        for i in range(_PARTS):
            total += abs(values[4 + i]) + abs(values[10 + i])
            if values[1 + i] < 0 or not 0 < values[7 + i] < 1 << 20:
                total = -1
                break
        if not 0 < total <= _WEIGHTS_MAX:
            raise ValueError("the line 'silicone' is out of range: calibrate again")
        self._state = array("i", bytes(8 * _PARTS))  # play operators in mN, creep in mN Q6
        self._t = self._x_um = self._force = 0

    def take(self, reading, t):
        """Correct the force of a reading in place; `t` is in ticks, see `tracker.TICK_US`."""
        self._follow_time(t)
        if reading[d.FLAGS] & d.LED_OFF:
            return
        force_mN = reading[d.FORCE_MN]
        if force_mN:
            x_um = reading[d.POSITION_UM]
            moved = force_mN > _SURE_MN and abs(x_um - self._x_um) > _APART_UM
            if moved:
                self._x_um = x_um
            force_mN = self._corrected(force_mN, moved)
            reading[d.FORCE_MN] = force_mN
        self._force = force_mN << 6

    # Small functions: a larger call frame would need the heap, see test_call_frames.

    def _follow_time(self, t):
        since = t - self._t & _TIME_MASK
        if since < _LEAST_T:
            return
        self._t = t
        since = min(since, _LONGEST_T)
        while since > 0:
            step = min(since, _STEP_T)
            since -= step
            for i in range(_PARTS):
                self._creep(i, step)

    def _creep(self, i, step):
        tau = (self._values[7 + i] * 125 >> 7) + 1
        off = self._force - self._state[_PARTS + i]
        off = off * min(step, tau) // tau
        self._state[_PARTS + i] += off

    def _corrected(self, force_mN, moved):
        total = self._values[0] * force_mN + 2048
        i = _PARTS
        while i:
            i -= 1
            if moved:
                self._state[_PARTS + i] = 0
            total -= self._excess(i, force_mN, moved) * self._values[4 + i]
            total -= self._values[10 + i] * (self._state[_PARTS + i] >> 6)
        return min(max(total >> 12, 1), 65_535)

    def _excess(self, i, force_mN, moved):
        # Force by which a play operator exceeds that of a first load.
        radius = self._values[1 + i]
        loading = max(force_mN - radius, 0)
        # The previous force is 0 if the finger had lifted.
        play = 0 if moved or not self._force else self._state[i]
        play = min(play, force_mN + radius)
        self._state[i] = play = max(play, loading)
        return play - loading
