"""Converts times of a board's link to another clock."""

from collections.abc import Callable

_WIDE_S = 1e-4  # a comparison that takes longer was interrupted
_TRIES = 5


class OtherClock:
    """Converts times of a board's link (`Board.now_s`) to the clock ``other_s()``.

    Both clocks are read with nothing between them, and a comparison that was interrupted is
    repeated: on a busy computer, the process may be suspended for some ms between two lines.
    """

    def __init__(self, other_s: Callable[[], float], now_s: Callable[[], float]):
        self._other_s, self._now_s = other_s, now_s

    def now_s(self) -> float:
        """Return the present time by the other clock, in seconds."""
        return self._other_s()

    def at(self, time_s: float) -> float:
        """Return a time of the board's link by the other clock, in seconds."""
        least_s = difference_s = float("inf")
        for _ in range(_TRIES):
            before_s, now_s, after_s = self._other_s(), self._now_s(), self._other_s()
            if after_s - before_s < least_s:
                least_s, difference_s = after_s - before_s, (before_s + after_s) / 2 - now_s
            if least_s < _WIDE_S:
                break
        return time_s + difference_s
