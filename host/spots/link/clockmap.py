"""Maps a board's time to the host's time."""

from collections import deque
from dataclasses import asdict, dataclass
from typing import Any

import numpy as np

from .frames import Reading, Text

_WRAP = 1 << 32  # us after which the board's time starts at 0 again
_TURN_S = _WRAP * 1e-6  # the same in seconds: 71.6 minutes
_SURE_S = 60.0  # allowed error when wraps are counted: far more than the error of the clocks
_TRIPS = 64  # number of stored round trips
_DRIFT_US = 30_000_000  # round trips over a shorter time show no drift
_DRIFT_MOST = 300e-6  # no pair of crystals drifts more (seconds per second)
_HALVINGS = 60  # steps of the search for the drift
_OFF_S = 1.0  # a larger error of the board's time shows that the board restarted


@dataclass(eq=False)
class ClockMap:
    """Unwraps a board's 32-bit time in microseconds, and maps this time to the host's clock.

    A query is sent at host time a, answered at board time t, and the reply arrives at host time b.
    So the host time of t lies between a and b: each round trip bounds the offset between the clocks
    from both sides. All bounds together are usually tighter than those of the shortest round trip.
    Because clocks drift, the offset is modelled as a linear function of time. Its slope is chosen
    so that the gap between the lower and the upper bounds of the latest 64 round trips is largest.

    `low_s` and `high_s` bound host time minus board time at `at_us`, the latest round trip; they
    are infinite before the first one. `slope` is the drift in seconds per second of board time.
    Board times are unwrapped here, and modulo 2**32 in the methods.
    """

    last_us: int = 0
    low_s: float = float("-inf")
    high_s: float = float("inf")
    at_us: int = 0
    slope: float = 0.0

    def __post_init__(self):
        self._trips: deque[tuple[int, float, float]] = deque(maxlen=_TRIPS)

    @property
    def uncertainty_s(self) -> float:
        """Largest possible error of the host times at `at_us`, in seconds."""
        return abs(self.high_s - self.low_s) / 2

    def unwrap(self, t_us: int) -> int:
        """Return the board time `t_us` (modulo 2**32) as a count in us that never wraps.

        Call this at least every 35 minutes (half a wrap), or a wrap is missed.
        """
        step = (t_us - self.last_us + _WRAP // 2) % _WRAP - _WRAP // 2
        self.last_us += step
        return self.last_us

    def state(self) -> dict[str, float]:
        """Return the constructor arguments of a copy that returns exactly the same times."""
        return asdict(self)

    def timed(self, frame: Reading | Text, arrived_s: float) -> Reading | Text:
        """Return a frame with its host time in `time_s`; return a `Text` unchanged."""
        if isinstance(frame, Text):
            return frame
        return frame._replace(time_s=self.host_s(frame.t_us, arrived_s))

    def round_trip(self, sent_s: float, t_us: int, received_s: float) -> None:
        """Narrow the bounds of the offset with the times of a query and of the board's reply."""
        board_us = self._unwrap(t_us, received_s)
        board_s = board_us * 1e-6
        self._trips.append((board_us, sent_s - board_s, received_s - board_s))
        self.at_us = board_us
        self.slope = self._best_slope()
        self.low_s, self.high_s = self._bounds(self.slope)

    def host_s(self, t_us: int, arrived_s: float) -> float | None:
        """Return the host time of a board time; None before the first round trip.

        The host time of its arrival shows how often the board's time has wrapped.
        """
        board_us = self._unwrap(t_us, arrived_s)
        if self.high_s == float("inf"):
            return None
        return board_us * 1e-6 + self._offset_s(board_us)

    def host_s_each(self, t_us: np.ndarray, arrived_s: np.ndarray) -> np.ndarray:
        """Return the host times of many board times: exactly the floats that `host_s` returns.

        All arrays have shape (n,), of int64 and float64; NaN before the first round trip.
        """
        half = _WRAP // 2
        steps = (np.diff(t_us, prepend=self.last_us) + half) % _WRAP - half
        board_us = self.last_us + np.cumsum(steps)
        host_s = board_us * 1e-6 + self._offset_s(board_us)
        if not np.all(arrived_s - host_s + _SURE_S < _TURN_S):  # a wrap may be missing
            each = [self.host_s(*one) for one in zip(t_us.tolist(), arrived_s.tolist())]
            return np.array(each, float)
        self.last_us += int(steps.sum())
        return host_s

    def shows_restart(self, sent_s: float, t_us: int, received_s: float) -> bool:
        """Return whether a round trip shows that the board has restarted; False before the first.

        A restarted board counts its time from 0, so the reply does not fit this map.
        """
        if self.high_s == float("inf"):
            return False
        board_s = t_us * 1e-6
        offset_s = self._offset_s(self.last_us)
        middle_s = (sent_s + received_s) / 2
        off_s = (middle_s - offset_s - board_s + _TURN_S / 2) % _TURN_S - _TURN_S / 2
        since_s = max(0.0, received_s - offset_s - self.at_us * 1e-6)
        return abs(off_s) > _OFF_S + (received_s - sent_s) / 2 + _DRIFT_MOST * since_s

    def _unwrap(self, t_us: int, arrived_s: float) -> int:
        """Return the unwrapped board time; `arrived_s` shows wraps during a gap between frames."""
        board_us = self.unwrap(t_us)
        if self.high_s != float("inf"):
            age_s = arrived_s - (board_us * 1e-6 + self._offset_s(board_us))
            # Data from a buffer may be old, but less than one wrap (71 minutes).
            self.last_us += max(0, int((age_s + _SURE_S) // _TURN_S)) * _WRAP
        return self.last_us

    def _offset_s(self, board_us: Any) -> Any:
        middle_s = (self.low_s + self.high_s) / 2
        return middle_s + self.slope * ((board_us - self.at_us) * 1e-6)

    def _bounds(self, slope: float) -> tuple[float, float]:
        lines = [
            (low_s - (rise_s := slope * ((us - self.at_us) * 1e-6)), high_s - rise_s)
            for us, low_s, high_s in self._trips
        ]
        return max(low_s for low_s, _ in lines), min(high_s for _, high_s in lines)

    def _best_slope(self) -> float:
        if self._trips[-1][0] - self._trips[0][0] < _DRIFT_US:
            return 0.0
        # The gap between the bounds is a concave function of the slope: a ternary search.
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
