"""The rate of messages to a page: as many as it draws without delay."""

from __future__ import annotations

from collections.abc import Callable

WINDOW = 2  # messages that a page may not have drawn yet
SOONEST_S = 1 / 60
SELDOM_S = 0.1
# A page that keeps up has drawn a message at the next frame of its screen or the one after, and
# what it took on the way is no fault of its own.
LATE_S = 0.03
_SLOWER, _FASTER = 1.25, 0.99


class PagePace:
    """The pace of one page, from the times of its messages and of their acknowledgements.

    Where processors are short, more messages do not show more, they only wait longer. So each
    that was drawn late makes those that follow much rarer, and each that was not, a little more
    frequent. Nobody has to know how many pages share a processor.

    Parameters
    ----------
    now_s : callable

    Attributes
    ----------
    every_s : float
        How long to wait after a message.
    sent, drawn : int
        Number of the last message that was sent, and that was drawn.
    """

    def __init__(self, now_s: Callable[[], float]):
        self._now_s = now_s
        self._sent_s: dict[int, float] = {}
        self._way_s: float | None = None
        self.every_s = SOONEST_S
        self.sent = self.drawn = 0

    @property
    def full(self) -> bool:
        """Whether as much is on its way as may be."""
        return self.sent - self.drawn >= WINDOW

    def send(self) -> int:
        """Return the number of a message that is sent now."""
        self.sent += 1
        self._sent_s[self.sent] = self._now_s()
        return self.sent

    def acknowledge(self, number: int) -> None:
        """Record that a page has drawn all messages up to one."""
        for one in range(self.drawn + 1, min(number, self.sent) + 1):
            late = self._now_s() - self._sent_s.pop(one) > LATE_S + (self._way_s or 0.0)
            every_s = self.every_s * (_SLOWER if late else _FASTER)
            self.every_s = min(max(every_s, SOONEST_S), SELDOM_S)
            self.drawn = one

    def answered(self, way_s: float) -> None:
        """Record the round-trip time of a ping, which needs no drawing.

        The least counts: where processors are short, such an answer waits for them, too.
        """
        self._way_s = way_s if self._way_s is None else min(self._way_s, way_s)
