"""What is due when a board that streams is silent, and when its port is away."""

from __future__ import annotations

import time

# A board that is silent for so long, and for so many readings, is asked whether it has restarted.
# A question or its answer may be damaged: another one follows, soon at first.
_SILENCE_S = 0.15
_SILENT_READINGS = 3
_ASK_LATER_S = 0.05  # more from one question without an answer to the next
_ASK_EVERY_S = 0.5  # but no more than this
# Without a reading for so long, and for so many of them, it has stalled.
_STALLED_S = 0.5
# A port is looked for so often at first, and half as often each time, but no less than that.
_REOPEN_S = 0.1
_REOPEN_MOST_S = 1.0


class Silence:
    """How long nothing has come from a board whose port is there, by the clock of its link.

    Parameters
    ----------
    now_s : float

    Attributes
    ----------
    every_s : float
        From one reading to the next.
    ask_s : float
        When to ask, if nothing comes.
    first_asked_s : float
        When the first question was sent since it was heard.
    """

    def __init__(self, now_s: float):
        self.every_s = 0.0
        self.ask_s = now_s
        self.first_asked_s = now_s
        self._asked = 0
        self._stalled_s = float("inf")

    def heard(self, now_s: float) -> None:
        """Take note of anything that came."""
        self._asked = 0
        self.ask_s = now_s + max(_SILENCE_S, _SILENT_READINGS * self.every_s)

    def read(self, now_s: float) -> None:
        """Take note of a reading, or that readings begin now."""
        self._stalled_s = now_s + max(_STALLED_S, _SILENT_READINGS * self.every_s)

    def stalled(self, now_s: float) -> bool:
        """Return whether readings should have come."""
        return now_s > self._stalled_s

    def asking(self, now_s: float) -> None:
        """Take note of a question that is sent now."""
        if self._asked == 0:
            self.first_asked_s = now_s
        self._asked += 1

    def unanswered(self, now_s: float) -> None:
        """Take note that no answer came to it."""
        self.ask_s = now_s + min(_ASK_EVERY_S, _ASK_LATER_S * (self._asked - 1))


class Away:
    """A port that went away now, by the clock of the process: its link has none meanwhile.

    Attributes
    ----------
    is_open : bool
        Whether it is back, and nobody knows yet who is there.
    asked : int
        How often who is there was asked since.
    refused : bool
        Whether it was another board.
    """

    def __init__(self):
        self._since_s = self._due_s = time.monotonic()
        self._wait_s = _REOPEN_S
        self.is_open = False
        self.asked = 0
        self.refused = False

    @property
    def for_s(self) -> float:
        """How long it has been away."""
        return time.monotonic() - self._since_s

    def waits(self, most_s: float) -> bool:
        """Return whether it is too soon to look for it, after a sleep until then or `most_s`."""
        left_s = self._due_s - time.monotonic()
        if left_s > 0:
            time.sleep(min(most_s, left_s))
        return left_s > 0

    def look_later(self) -> None:
        """Take note that it was not there, or not the right one."""
        self.is_open = False
        self._due_s = time.monotonic() + self._wait_s
        self._wait_s = min(2 * self._wait_s, _REOPEN_MOST_S)
