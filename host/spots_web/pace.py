"""Finds the highest rate of messages that a browser can draw in time."""

import asyncio
from collections.abc import Callable

WINDOW = 2  # largest number of messages that are not drawn yet
SOONEST_S = 1 / 60  # shortest interval between two messages
SELDOM_S = 0.1  # longest interval
# A browser that keeps up draws a message within two frames of its screen. The time on the network
# is added to this limit.
LATE_S = 0.03
_SLOWER, _FASTER = 1.25, 0.99  # factors of the interval after a late and after any other message


class PagePace:
    """Rate control for one browser window, from the times of messages and acknowledgements.

    On a busy processor, a higher rate only makes messages wait longer. So after a message that was
    drawn late, the interval grows by 25 %; after any other message it shrinks by 1 %. Windows that
    share a processor thus find the rate at which the processor can draw. `sent` and `drawn` are the
    numbers of the last such messages.
    """

    def __init__(self, now_s: Callable[[], float]):
        self._now_s = now_s
        self._sent_s: dict[int, float] = {}
        self._way_s: float | None = None
        self._pinged = b"", 0.0  # payload of the last ping, and its time
        self._drew = asyncio.Event()
        self.every_s = SOONEST_S
        self.sent = self.drawn = 0

    @property
    def full(self) -> bool:
        """Whether the browser must draw a message before another message may be sent."""
        return self.sent - self.drawn >= WINDOW

    async def room(self) -> None:
        """Wait until another message may be sent to the browser."""
        while self.full:
            self._drew.clear()
            await self._drew.wait()

    def send(self) -> int:
        """Record that a message is sent to the browser now, and return the message's number."""
        self.sent += 1
        self._sent_s[self.sent] = self._now_s()
        return self.sent

    def acknowledge(self, number: int) -> None:
        """Record that the browser has drawn all messages up to this number."""
        for one in range(self.drawn + 1, min(number, self.sent) + 1):
            late = self._now_s() - self._sent_s.pop(one) > LATE_S + (self._way_s or 0.0)
            every_s = self.every_s * (_SLOWER if late else _FASTER)
            self.every_s = min(max(every_s, SOONEST_S), SELDOM_S)
            self.drawn = one
        self._drew.set()

    def ping(self) -> bytes:
        """Return the payload of a new ping. A browser answers pings even while it draws."""
        self._pinged = str(self.sent).encode(), self._now_s()
        return self._pinged[0]

    def pong(self, payload: bytes) -> None:
        """Handle a pong; ignore a pong that does not answer the last ping."""
        asked, asked_s = self._pinged
        if payload == asked:
            self.answered(self._now_s() - asked_s)

    def answered(self, way_s: float) -> None:
        """Record the round-trip time of a ping, in seconds.

        A message is late if its acknowledgement takes longer than `LATE_S` plus the smallest
        round-trip time. Larger round-trip times are not used, because a busy processor also delays
        the answer to a ping.
        """
        self._way_s = way_s if self._way_s is None else min(self._way_s, way_s)
