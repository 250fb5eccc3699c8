"""Maps a board's time to the host's time."""

from collections import deque
from dataclasses import asdict, dataclass
from typing import Any

import numpy as np

from .frames import Reading, Text

_WRAP = 1 << 32  # us after which the board's time starts at 0 again
_TURN_S = _WRAP * 1e-6  # the same in seconds: 71.6 minutes
_SURE_S = 60.0  # allowed error when wraps are counted: far more than the error of the clocks
_BACK_US = 60_000_000  # a frame may be older than the frame before it, by less than this
_TRIPS = 64  # number of stored round trips
_DRIFT_US = 30_000_000  # round trips over a shorter time show no drift
_DRIFT_MOST = 300e-6  # no pair of crystals drifts more (seconds per second)
_HALVINGS = 60  # steps of the search for the drift
_OFF_S = 1.0  # a larger error of the board's time shows that the board restarted
_AHEAD_S = 0.1  # a frame that is measured so long after its arrival shows that the host slept


@dataclass(eq=False)
class ClockMap:
    """Unwraps a board's 32-bit time in microseconds, and maps this time to the host's clock.

    A query is sent at host time a, answered at board time t, and the reply arrives at host time b.
    So the host time of t lies between a and b: each round trip bounds the offset between the clocks
    from both sides. All bounds together are usually tighter than those of the shortest round trip.
    Because clocks drift, the offset is modelled as a linear function of time. Its slope is chosen
    so that the gap between the lower and the upper bounds of the latest 64 round trips is largest.
    Of round trips that contradict each other, the older ones are dropped.

    The host's clock stands still while the computer sleeps or its virtual machine is paused; the
    board's clock runs on. A frame that seems to arrive before its measurement shows this: until the
    next round trip, such frames have the time of their arrival. `slept_s` is the sum of such times,
    and `jumps` counts how often the map had to begin again.

    `low_s` and `high_s` bound host time minus board time at `at_us`, the latest round trip; they
    are infinite before the first one. `slope` is the drift in seconds per second of board time.
    Board times are unwrapped here, and modulo 2**32 in the methods.
    """

    last_us: int = 0
    low_s: float = float("-inf")
    high_s: float = float("inf")
    at_us: int = 0
    slope: float = 0.0
    slept_s: float = 0.0

    def __post_init__(self):
        self._trips: deque[tuple[int, float, float]] = deque(maxlen=_TRIPS)
        self._by_arrival = False  # whether a frame's arrival, and no round trip, made the bounds
        self.jumps = 0

    @property
    def uncertainty_s(self) -> float:
        """Largest possible error of the host times at `at_us`, in seconds."""
        return abs(self.high_s - self.low_s) / 2

    def unwrap(self, t_us: int) -> int:
        """Return the board time `t_us` (modulo 2**32) as a count in us that never wraps.

        Call this at least every 70 minutes (a wrap less `_BACK_US`), or a wrap is missed.
        """
        step = (t_us - self.last_us + _BACK_US) % _WRAP - _BACK_US
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
        before_s = self._offset_s(board_us)
        self.at_us = board_us
        self.slope = self._best_slope()
        self.low_s, self.high_s = self._bounds(self.slope)
        trips = len(self._trips)
        while self.low_s > self.high_s and len(self._trips) > 1:
            for _ in range(len(self._trips) // 2):
                self._trips.popleft()
            self.slope = self._best_slope()
            self.low_s, self.high_s = self._bounds(self.slope)
        jump_s = before_s - self._offset_s(board_us)
        if trips > len(self._trips) == 1 and abs(jump_s) > _AHEAD_S and not self._by_arrival:
            self.jumps += 1
            self.slept_s += max(0.0, jump_s)
        self._by_arrival = False

    def host_s(self, t_us: int, arrived_s: float) -> float | None:
        """Return the host time of a board time; None before the first round trip.

        The host time of its arrival shows how often the board's time has wrapped, and whether the
        host has slept.
        """
        board_us = self._unwrap(t_us, arrived_s)
        if self.high_s == float("inf"):
            return None
        found_s = board_us * 1e-6 + self._offset_s(board_us)
        early_s = found_s - arrived_s
        if early_s > 0.0 and early_s > self._early_most_s(board_us):
            self._follow_arrival(board_us, early_s, arrived_s)
            return arrived_s
        return found_s

    def host_s_each(self, t_us: np.ndarray, arrived_s: np.ndarray) -> np.ndarray:
        """Return the host times of many board times: exactly the floats that `host_s` returns.

        All arrays have shape (n,), of int64 and float64; NaN before the first round trip.
        """
        steps = (np.diff(t_us, prepend=self.last_us) + _BACK_US) % _WRAP - _BACK_US
        board_us = self.last_us + np.cumsum(steps)
        host_s = board_us * 1e-6 + self._offset_s(board_us)
        age_s = arrived_s - host_s
        # Otherwise a wrap may be missing, or the host may have slept.
        least_s = 0.0 if self._by_arrival else -_AHEAD_S
        if not np.all((age_s >= least_s) & (age_s + _SURE_S < _TURN_S)):
            each = [self.host_s(*one) for one in zip(t_us.tolist(), arrived_s.tolist())]
            return np.array(each, float)
        self.last_us += int(steps.sum())
        return host_s

    def ahead_s(self, sent_s: float, t_us: int, received_s: float) -> float:
        """Return by how much a round trip shows the board's time ahead of this map; 0 if it fits.

        After a restart, a board counts its time from 0; while the host sleeps, the board's time
        runs on. The result is modulo the wrap of the board's time: -35.8 to 35.8 minutes.
        """
        if self.high_s == float("inf"):
            return 0.0
        board_s = t_us * 1e-6
        offset_s = self._offset_s(self.last_us)
        middle_s = (sent_s + received_s) / 2
        off_s = (middle_s - offset_s - board_s + _TURN_S / 2) % _TURN_S - _TURN_S / 2
        since_s = max(0.0, received_s - offset_s - self.at_us * 1e-6)
        most_s = _OFF_S + (received_s - sent_s) / 2 + _DRIFT_MOST * since_s
        return -off_s if abs(off_s) > most_s else 0.0

    def _unwrap(self, t_us: int, arrived_s: float) -> int:
        """Return the unwrapped board time; `arrived_s` shows wraps during a gap between frames."""
        board_us = self.unwrap(t_us)
        if self.high_s != float("inf"):
            age_s = arrived_s - (board_us * 1e-6 + self._offset_s(board_us))
            # Data from a buffer may be old, but less than one wrap (71 minutes).
            self.last_us += max(0, int((age_s + _SURE_S) // _TURN_S)) * _WRAP
        return self.last_us

    def _early_most_s(self, board_us: int) -> float:
        """Return by how much a measurement may seem to be later than its arrival."""
        if self._by_arrival:
            return 0.0
        since_s = abs(board_us - self.at_us) * 1e-6
        return _AHEAD_S + self.uncertainty_s + _DRIFT_MOST * since_s

    def _follow_arrival(self, board_us: int, early_s: float, arrived_s: float) -> None:
        """Replace the bounds by the arrival of a frame that came `early_s` before its time."""
        self.slept_s += early_s
        self.jumps += not self._by_arrival
        self._by_arrival = True
        self._trips.clear()
        offset_s = arrived_s - board_us * 1e-6
        self.at_us, self.low_s, self.high_s = board_us, offset_s - _OFF_S, offset_s + _OFF_S

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
