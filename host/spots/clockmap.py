"""Board time to host time."""

from __future__ import annotations

from .frames import Frame, Text

_WRAP = 1 << 32


class ClockMap:
    """Unwraps a board's 32-bit microseconds and maps them to the host's clock.

    A command sent at host time a is answered at board time t, and the answer is there at b: that
    moment lies between a and b. Each round trip bounds the offset between the clocks from both
    sides; the bounds of all of them together leave less than the shortest one alone.
    """

    def __init__(self):
        self._last_us = 0
        self._low_s = float("-inf")
        self._high_s = float("inf")

    @property
    def uncertainty_s(self) -> float:
        """Half of what the bounds leave open."""
        return (self._high_s - self._low_s) / 2

    def unwrap(self, t_us: int) -> int:
        """Return `t_us` (modulo 2**32) as a count that does not wrap, if asked within 35 min."""
        step = (t_us - self._last_us + _WRAP // 2) % _WRAP - _WRAP // 2
        self._last_us += step
        return self._last_us

    def state(self) -> dict:
        """Return all that it knows, so that `resume` maps later times to the same floats."""
        return {"last_us": self._last_us, "low_s": self._low_s, "high_s": self._high_s}

    @classmethod
    def resume(cls, last_us: int, low_s: float, high_s: float) -> ClockMap:
        """Return a map with the `state` of another one."""
        clock = cls()
        clock._last_us, clock._low_s, clock._high_s = last_us, low_s, high_s
        return clock

    def timed(self, frame: Frame) -> Frame:
        """Return a board's frame with its host time; a text has none."""
        if isinstance(frame, Text):
            return frame
        return frame._replace(time_s=self.host_s(frame.t_us))

    def round_trip(self, sent_s: float, t_us: int, received_s: float) -> None:
        """Learn from a round trip."""
        board_s = self.unwrap(t_us) * 1e-6
        self._low_s = max(self._low_s, sent_s - board_s)
        self._high_s = min(self._high_s, received_s - board_s)

    def host_s(self, t_us: int) -> float | None:
        """Return the host time of a board time, or None before any round trip."""
        board_us = self.unwrap(t_us)
        if self._high_s == float("inf"):
            return None
        return board_us * 1e-6 + (self._low_s + self._high_s) / 2
