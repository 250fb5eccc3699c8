"""Timeouts and back-off while a board is silent or unplugged, by the clock of its link.

From the moment at which readings stop: the board is asked after `ASK_S`, applications release what
they hold after `RELEASE_S`, the board counts as stalled after `STALLED_S`, and the page closes it
and searches again after `SEARCH_S`. Where the port is unplugged, it is looked for with a growing
back-off, and `Board.frames` raises an error after `PATIENCE_S`.
"""

from __future__ import annotations

# Of slow boards: none of ASK_S, STALLED_S and SEARCH_S is over before so many readings are missed.
_SILENT_READINGS = 3

ASK_S = 0.15
RELEASE_S = 0.3  # without a reading for so long, nobody knows of a finger any more
STALLED_S = 0.5
SEARCH_S = 2.0
PATIENCE_S = 10.0  # a board takes some seconds to be a USB device again

# For an answer of a board that may have restarted. A question or its answer may be damaged: the
# next one follows soon at first.
ANSWER_S = 0.1
_ASK_LATER_S = 0.05  # more from one question without an answer to the next
_ASK_EVERY_S = 0.5  # but no more than this

# A lost port is looked for so often at first, and half as often each time, but no less than that.
_REOPEN_S = 0.1
_REOPEN_MOST_S = 1.0
# On a port that is back, to hear who answers.
WHO_S = 0.3
WHO_TRIES = 5


def silent_s(least_s: float, every_s: float) -> float:
    """Return a timeout for a board with so much time from one reading to the next."""
    return max(least_s, _SILENT_READINGS * every_s)


class Silence:
    """How long nothing has come from a board whose port is there.

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
        """Record that anything came."""
        self._asked = 0
        self.ask_s = now_s + silent_s(ASK_S, self.every_s)

    def read(self, now_s: float) -> None:
        """Record a reading, or that readings begin now."""
        self._stalled_s = now_s + silent_s(STALLED_S, self.every_s)

    def stalled(self, now_s: float) -> bool:
        """Return whether readings should have come."""
        return now_s > self._stalled_s

    def asking(self, now_s: float) -> None:
        """Record a question that is sent now."""
        if self._asked == 0:
            self.first_asked_s = now_s
        self._asked += 1

    def unanswered(self, now_s: float) -> None:
        """Record that no answer came to it."""
        self.ask_s = now_s + min(_ASK_EVERY_S, _ASK_LATER_S * (self._asked - 1))


class Away:
    """A port that was unplugged.

    Parameters
    ----------
    now_s : float

    Attributes
    ----------
    is_open : bool
        Whether it is back, and nobody knows yet who is there.
    asked : int
        How often who is there was asked since.
    refused : bool
        Whether it was another board.
    """

    def __init__(self, now_s: float):
        self._since_s = self._due_s = now_s
        self._wait_s = _REOPEN_S
        self.is_open = False
        self.asked = 0
        self.refused = False

    def for_s(self, now_s: float) -> float:
        """Return how long it has been away."""
        return now_s - self._since_s

    def due_in_s(self, now_s: float) -> float:
        """Return how long to wait before it is looked for; not positive if it is time."""
        return self._due_s - now_s

    def look_later(self, now_s: float) -> None:
        """Record that it was not there, or not the right one."""
        self.is_open = False
        self._due_s = now_s + self._wait_s
        self._wait_s = min(2 * self._wait_s, _REOPEN_MOST_S)
