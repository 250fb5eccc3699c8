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

    def keep(self, now_s: float) -> None:
        """Schedule regular queries of the board's time; `now_s` is the host time, in seconds."""
        self._waits = _waits(0)
        self.due_s = now_s + next(self._waits)

    def restart(self, sent_s: float, t_us: int, received_s: float) -> None:
        """Start a new map from a single round trip, and schedule more queries soon."""
        self.clock = ClockMap()
        self.clock.round_trip(sent_s, t_us, received_s)
        self._sent_s = self._answer = None
        self._waits = _waits(TRIPS)
        self.due_s = received_s

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

    def learn(self) -> None:
        """Update the map with the last reply.

        Call this between two reads of the link, so that all frames of a read use the same map.
        """
        if self._answer is not None:
            self.clock.round_trip(*self._answer)
            self._answer = None


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
