"""Board time to host time."""

from __future__ import annotations

from collections import deque
from typing import Any

import numpy as np

from .frames import Reading, Text

_WRAP = 1 << 32
_TURN_S = _WRAP * 1e-6
_SURE_S = 60.0  # far more than the clocks can be off
_TRIPS = 64
# Trips that lie closer together show no drift; no pair of crystals drifts more.
_DRIFT_US = 30_000_000
_DRIFT_MOST = 300e-6
_HALVINGS = 60
# A board's time that is off by more than the clocks can be shows that it restarted.
_OFF_S = 1.0


class ClockMap:
    """Unwraps a board's 32-bit microseconds and maps them to the host's clock.

    A command sent at host time a is answered at board time t, and the answer is there at b: that
    moment lies between a and b. Each round trip bounds the offset between the clocks from both
    sides; the bounds of all of them together leave less than the shortest one alone. Clocks drift,
    so that the offset is a line: the one with the most room between the bounds of the latest
    trips.
    """

    def __init__(self):
        self._last_us = 0
        self._trips: deque[tuple[int, float, float]] = deque(maxlen=_TRIPS)
        self._low_s = float("-inf")
        self._high_s = float("inf")
        self._at_us = 0  # the bounds are those of the offset at this board time
        self._slope = 0.0

    @property
    def uncertainty_s(self) -> float:
        """Half of what the bounds leave open."""
        return abs(self._high_s - self._low_s) / 2

    @property
    def drift_ppm(self) -> float:
        """How much faster the board's clock runs than the host's."""
        return -1e6 * self._slope

    def unwrap(self, t_us: int) -> int:
        """Return `t_us` (modulo 2**32) as a count that does not wrap, if asked within 35 min."""
        step = (t_us - self._last_us + _WRAP // 2) % _WRAP - _WRAP // 2
        self._last_us += step
        return self._last_us

    def state(self) -> dict[str, float]:
        """Return all that it knows, so that `resume` maps later times to the same floats."""
        return {
            "last_us": self._last_us,
            "low_s": self._low_s,
            "high_s": self._high_s,
            "at_us": self._at_us,
            "slope": self._slope,
        }

    @classmethod
    def resume(
        cls, last_us: int, low_s: float, high_s: float, at_us: int = 0, slope: float = 0.0
    ) -> ClockMap:
        """Return a map with the `state` of another one.

        Parameters
        ----------
        last_us : int
            Latest board time, unwrapped, in us.
        low_s, high_s : float
            Bounds on host time minus board time at `at_us`, in seconds.
        at_us : int
            Board time of the latest round trip, unwrapped, in us.
        slope : float
            Drift of the offset, in seconds a second of board time.

        Returns
        -------
        ClockMap
            Maps later times to the same floats as that map.
        """
        clock = cls()
        clock._last_us, clock._low_s, clock._high_s = last_us, low_s, high_s
        clock._at_us, clock._slope = at_us, slope
        return clock

    def timed(self, frame: Reading | Text, arrived_s: float) -> Reading | Text:
        """Return a board's frame with its host time; a text is returned unchanged.

        Parameters
        ----------
        frame : Touch, Spectrum, Key or Text
            As decoded.
        arrived_s : float
            When it arrived, by the host's clock, in seconds.

        Returns
        -------
        Touch, Spectrum, Key or Text
            With `time_s`, unless it is a text.
        """
        if isinstance(frame, Text):
            return frame
        return frame._replace(time_s=self.host_s(frame.t_us, arrived_s))

    def round_trip(self, sent_s: float, t_us: int, received_s: float) -> None:
        """Narrow the bounds by a round trip.

        Parameters
        ----------
        sent_s : float
            Host time at which the question was sent, in seconds.
        t_us : int
            Board time at which it was answered, modulo 2**32, in us.
        received_s : float
            Host time at which the answer was there, in seconds.
        """
        board_us = self._unwrap(t_us, received_s)
        board_s = board_us * 1e-6
        self._trips.append((board_us, sent_s - board_s, received_s - board_s))
        self._at_us = board_us
        self._slope = self._best_slope()
        self._low_s, self._high_s = self._bounds(self._slope)

    def host_s(self, t_us: int, arrived_s: float) -> float | None:
        """Return the host time of a board time.

        Parameters
        ----------
        t_us : int
            Board time modulo 2**32, in us.
        arrived_s : float
            Host time at which it arrived, in seconds; it resolves the wrap of `t_us`.

        Returns
        -------
        float or None
            In seconds; None before any round trip.
        """
        board_us = self._unwrap(t_us, arrived_s)
        if self._high_s == float("inf"):
            return None
        return board_us * 1e-6 + self._offset_s(board_us)

    def host_s_each(self, t_us: np.ndarray, arrived_s: np.ndarray) -> np.ndarray:
        """Return what `host_s` returns of one after the other, to the last bit; NaN for None.

        Parameters
        ----------
        t_us : ndarray of int64
            Board times modulo 2**32.
        arrived_s : ndarray of float64
            When each of them came.

        Returns
        -------
        ndarray of float64
            Host times, in seconds; NaN before any round trip.
        """
        half = _WRAP // 2
        steps = (np.diff(t_us, prepend=self._last_us) + half) % _WRAP - half
        board_us = self._last_us + np.cumsum(steps)
        host_s = board_us * 1e-6 + self._offset_s(board_us)
        if not np.all(arrived_s - host_s + _SURE_S < _TURN_S):  # nobody asked for too long
            each = [self.host_s(*one) for one in zip(t_us.tolist(), arrived_s.tolist())]
            return np.array(each, float)
        self._last_us += int(steps.sum())
        return host_s

    def shows_restart(self, sent_s: float, t_us: int, received_s: float) -> bool:
        """Return whether a round trip shows that the board has restarted.

        Parameters
        ----------
        sent_s : float
            Host time at which the question was sent, in seconds.
        t_us : int
            Board time at which it was answered, modulo 2**32, in us.
        received_s : float
            Host time at which the answer was there, in seconds.

        Returns
        -------
        bool
            Always False before the first round trip.
        """
        if self._high_s == float("inf"):
            return False
        told_s = t_us * 1e-6
        offset_s = self._offset_s(self._last_us)
        middle_s = (sent_s + received_s) / 2
        off_s = (middle_s - offset_s - told_s + _TURN_S / 2) % _TURN_S - _TURN_S / 2
        since_s = max(0.0, received_s - offset_s - self._at_us * 1e-6)
        return abs(off_s) > _OFF_S + (received_s - sent_s) / 2 + _DRIFT_MOST * since_s

    def _unwrap(self, t_us: int, arrived_s: float) -> int:
        """Return it as `unwrap` does, however long nobody asked, where the clocks are known."""
        board_us = self.unwrap(t_us)
        if self._high_s != float("inf"):
            age_s = arrived_s - (board_us * 1e-6 + self._offset_s(board_us))
            # What waited in a buffer is old, but none so old.
            self._last_us += max(0, int((age_s + _SURE_S) // _TURN_S)) * _WRAP
        return self._last_us

    def _offset_s(self, board_us: Any) -> Any:
        middle_s = (self._low_s + self._high_s) / 2
        return middle_s + self._slope * ((board_us - self._at_us) * 1e-6)

    def _bounds(self, slope: float) -> tuple[float, float]:
        lines = [
            (low_s - (rise_s := slope * ((us - self._at_us) * 1e-6)), high_s - rise_s)
            for us, low_s, high_s in self._trips
        ]
        return max(low_s for low_s, _ in lines), min(high_s for _, high_s in lines)

    def _best_slope(self) -> float:
        if self._trips[-1][0] - self._trips[0][0] < _DRIFT_US:
            return 0.0
        # What the bounds leave is a concave function of the slope.
        low, high = -_DRIFT_MOST, _DRIFT_MOST
        for _ in range(_HALVINGS):
            third = (high - low) / 3
            if self._room_s(low + third) < self._room_s(high - third):
                low += third
            else:
                high -= third
        return (low + high) / 2

    def _room_s(self, slope: float) -> float:
        low_s, high_s = self._bounds(slope)
        return high_s - low_s
