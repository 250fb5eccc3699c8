"""Schedules queries of a board's time, and passes the replies to the clock map."""

import itertools
from collections.abc import Iterator

from .clockmap import ClockMap

TRIPS = 12  # number of round trips when a board is opened or has restarted
# Round trips should begin at different moments of the board's loop. So each pause before a round
# trip is longer by up to `_SPREAD_S`, in steps of the golden ratio, which are spread evenly.
_SPREAD_S = 0.01
_GOLDEN = 0.618034
_SOON_S = 0.03  # pause between the `TRIPS` round trips after a restart
# Later queries measure only the drift. Each may cost a sample, because the board collects garbage
# after a command. The first pause is `_FIRST_S`; the pauses double up to `_EVERY_S`.
_FIRST_S = 5.0
_EVERY_S = 60.0
_NEVER = float("inf")


class ClockSync:
    """Keeps a clock map up to date with regular queries of the board's time.

    `due_s` is the host time of the next query; infinite if no queries are scheduled.
    """

    def __init__(self):
        self.clock = ClockMap()
        self.due_s = _NEVER
        self._waits: Iterator[float] = iter(())
        self._sent_s: float | None = None  # host time of the first unanswered query
        self._answer: tuple[float, int, float] | None = None
        self._jumps = 0  # those of the map for which queries are scheduled

    def keep(self, now_s: float) -> None:
        """Schedule regular queries of the board's time; `now_s` is the host time, in seconds."""
        self._waits = _waits(0)
        self.due_s = now_s + next(self._waits)

    def restart(self, sent_s: float, t_us: int, received_s: float, slept_s: float = 0.0) -> None:
        """Start a new map from a single round trip, and schedule more queries soon.

        `slept_s` is for how long the host's clock stood still, in seconds.
        """
        self.clock = ClockMap(slept_s=self.clock.slept_s + slept_s)
        self.clock.round_trip(sent_s, t_us, received_s)
        self._sent_s = self._answer = None
        self._ask_soon(received_s)

    def ask(self, now_s: float) -> bytes:
        """Return the command that asks for the board's time; empty if no query is due."""
        if now_s < self.due_s:
            return b""
        self.due_s = now_s + next(self._waits)
        if self._sent_s is None:
            self._sent_s = now_s
        return b"sync\n"

    def answered(self, t_us: int, now_s: float) -> None:
        """Record the board's reply to a query; ignore a reply without a query."""
        if self._sent_s is not None:
            self._answer, self._sent_s = (self._sent_s, t_us, now_s), None

    def learn(self, now_s: float) -> None:
        """Update the map with the last reply; schedule more queries soon if the map has jumped.

        Call this between two reads of the link, so that all frames of a read use the same map.
        """
        if self._answer is not None:
            self.clock.round_trip(*self._answer)
            self._answer = None
        if self.clock.jumps > self._jumps and self.due_s < _NEVER:
            self._ask_soon(now_s)
        self._jumps = self.clock.jumps

    def _ask_soon(self, now_s: float) -> None:
        self._waits, self.due_s = _waits(TRIPS), now_s


def _waits(soon: int) -> Iterator[float]:
    """Yield the pauses between queries, in seconds: `soon` short ones, then growing ones."""
    for i in range(soon):
        yield _SOON_S + spread_s(i)
    for i in itertools.count():
        yield min(_EVERY_S, _FIRST_S * 2 ** min(i, 10)) + spread_s(i)


def spread_s(i: int) -> float:
    """Return an additional delay, in seconds, before round trip number `i`.

    The delays of successive round trips are spread evenly between 0 and 0.01 s, so that these round
    trips begin at different moments of the board's loop.
    """
    return i * _GOLDEN % 1 * _SPREAD_S
