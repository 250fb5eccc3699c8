"""Follows ambient light that changes between two dark samples, such as sun through moving leaves.

Its spectrum is that of the brightest recent dark frame. So only its share of this frame is unknown.
Without a touch, all light that exceeds the floor must have this spectrum. During a touch, more or
less ambient light shifts the misfit, which does not depend on position and force of the touch. A
second finger shifts the misfit, too. Then the next dark sample contradicts, and the rest of the
touch is not followed.
"""

from array import array

from ..sensor.smux import CHANNELS
from . import decode as d
from .dark import JUMP, chi2
from .lone import ignore

_LEAST = 12  # counts, sum of all channels: fainter light does not matter
_SHARE_MAX = 8191  # Q12
_MISFIT_MAX = 4095
_RATIO_MAX = 4096  # Q8
_TOTAL_MAX = 1 << 21
_FRESH = 2  # samples in the dark frame after it was moved, so that the next ones count
_LN2_Q13 = 5678  # ln 2 in Q13: from log2 to a share


class Ambient:
    """Moves the dark frame of a strip while the ambient light changes. Allocates nothing."""

    # The methods need at most 11 words for locals and arguments, see strip.py.

    def __init__(self, dark, baseline):
        self._dark = dark
        self._baseline = baseline
        self._state = dark.state
        self._lamp = array("i", bytes(4 * CHANNELS))  # counts
        self._total = self._share = 0
        self._moved = 0  # counts: sum of the dark frame when it was last moved
        self._is_contradicted = False

    def measured(self):
        """Take the spectrum from the dark frame, after a dark sample."""
        total = 0
        for i in range(CHANNELS):
            total += self._dark.mean[i] >> 12
        if self._moved and abs(total - self._moved) > self._total >> 2:
            self._is_contradicted = True
        self._moved = 0
        if total > self._total or not self._dark.changing:
            self._total = total
            for i in range(CHANNELS):
                self._lamp[i] = self._dark.mean[i] >> 12

    def follow(self, tables):
        """Move the dark frame according to the last lit reading; `tables` are as for `kernel`."""
        state = self._state
        ignore(state)
        if self._total < _LEAST or state[d.FLAGS] & (d.SATURATED | d.NOT_CALIBRATED):
            return
        if state[d.FLAGS] & d.TOUCHING:
            if not self._is_contradicted and self._is_shifted(tables):
                self._move()
                self._moved = 0
                for i in range(CHANNELS):
                    self._moved += self._dark.mean[i] >> 12
            return
        self._is_contradicted = False
        if self._is_ambient():
            self._baseline.unstick()
            self._move()
            self._moved = 0

    def _is_shifted(self, tables):
        off = self._state[d.OFF_Q12]
        if abs(off) <= self._state[d.TOLERANCE_Q12] >> 1:
            return False
        slope = self._slope(tables)
        if slope < 8:
            return False
        off = min(max(off, -_MISFIT_MAX), _MISFIT_MAX) * _LN2_Q13
        self._share = min(max(off // slope, -_SHARE_MAX), _SHARE_MAX)
        return True

    def _slope(self, tables):
        # Change of the misfit by all of the lamp's light, Q13; 0 if a channel is dark.
        total = 0
        for i in range(CHANNELS):
            net = self._net(i)
            if net <= 0:
                return 0
            net = (self._lamp[i] << 12) // net
            if net > _RATIO_MAX:
                net = _RATIO_MAX
            total += tables[d.WEIGHTS + CHANNELS + i] * net
        return total >> 8

    def _is_ambient(self):
        total = 0
        for i in range(CHANNELS):
            total += self._net(i)
        total = min(max(total, -_TOTAL_MAX), _TOTAL_MAX) << 8
        total //= self._total
        self._share = min(max(total, -_SHARE_MAX), _SHARE_MAX)
        return self._left() <= JUMP << 4

    def _left(self):
        # Chi-squared, Q4, of the light that the lamp does not explain.
        total = 0
        for i in range(CHANNELS):
            off = (self._net(i) << 4) - (self._share * self._lamp[i] >> 4)
            total += chi2(off, (self._lamp[i] >> 4) + 1)
        return total

    def _net(self, i):
        # Counts of a sample above the floor, Q4.
        state = self._state
        return (state[d.SUMS + i] << 4) // state[d.SAMPLES] - (
            state[d.DARK + i] + state[d.BASELINE + i] >> 8
        )

    def _move(self):
        mean = self._dark.mean
        for i in range(CHANNELS):
            level = mean[i] + self._share * self._lamp[i]
            mean[i] = min(max(level, 0), d.COUNT_MAX_Q12)
        self._dark.count = min(self._dark.count, _FRESH)
        self._baseline.update()
        self._expect()

    def _expect(self):
        # The light without a touch, as in `kernel`.
        state = self._state
        floor = 0
        for i in range(d.FLOOR, d.FLOOR + CHANNELS):
            floor += state[i]
        state[d.LEVEL] = floor // state[d.FLOOR_SAMPLES] + 1
