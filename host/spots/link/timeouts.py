"""Timeouts and back-off while a board is silent or unplugged, by the clock of its link.

From the moment at which readings stop: the board is asked after `ASK_S`, applications release what
they hold after `RELEASE_S`, the board counts as stalled after `STALLED_S`, and the web UI closes it
and searches again after `SEARCH_S`. An unplugged port is looked for with a growing back-off, and
`Board.frames` raises an error after `PATIENCE_S`.
"""

from __future__ import annotations

# States of a link. Whoever has no board yet is searching for one.
SEARCHING, CONNECTED, STALLED = "searching", "connected", "stalled"
LOST, REFUSED = "lost", "refused"

_NEVER = float("inf")
# On slow boards ASK_S, STALLED_S and SEARCH_S last until so many readings are missing.
_SILENT_READINGS = 3

ASK_S = 0.15
RELEASE_S = 0.3  # without a reading for so long, the touch is unknown
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
    """Return a timeout for a board with so much time from one reading to the next.

    Parameters
    ----------
    least_s : float
        Least timeout, in seconds.
    every_s : float
        Time from one reading to the next, in seconds.

    Returns
    -------
    float
        In seconds.
    """
    return max(least_s, _SILENT_READINGS * every_s)


class LinkLoss:
    """State machine of a link that may stall or be unplugged.

    While readings are expected, it is ``connected`` until none has come for `STALLED_S`, then
    ``stalled``. An unplugged port makes it ``lost``; ``refused`` while another board is there.

    Parameters
    ----------
    now_s : float
        By the clock of the link, as all times here.

    Attributes
    ----------
    every_s : float
        From one reading to the next.
    ask_s : float
        When to ask, if nothing comes.
    first_asked_s : float
        When the first question since the last frame was sent.
    is_open : bool
        Whether an unplugged port is open again, and the board behind it not known yet.
    tries : int
        How often the board behind it was asked who it is.
    """

    def __init__(self, now_s: float):
        self.every_s = 0.0
        self.ask_s = self.first_asked_s = now_s
        self.is_open = self._refused = False
        self.tries = self._asked = 0
        self._expected_s = _NEVER  # when the last reading came, or readings began
        self._unplugged_s = self.reopen_s = _NEVER

    @property
    def unplugged(self) -> bool:
        """Whether the port is not there, or the board behind it not known yet."""
        return self._unplugged_s < _NEVER

    def state(self, now_s: float) -> str:
        """Return `CONNECTED`, `STALLED`, `LOST` or `REFUSED`."""
        if self.unplugged:
            return REFUSED if self._refused else LOST
        return STALLED if self.silent(now_s, STALLED_S) else CONNECTED

    def silent(self, now_s: float, least_s: float) -> bool:
        """Return whether no reading has come for `least_s`, or three readings if that is more.

        Parameters
        ----------
        now_s : float
            In seconds.
        least_s : float
            Least timeout, in seconds.

        Returns
        -------
        bool
        """
        return now_s - self._expected_s > silent_s(least_s, self.every_s)

    def heard(self, now_s: float) -> None:
        """Record a frame of any kind."""
        self._asked = 0
        self.ask_s = now_s + silent_s(ASK_S, self.every_s)

    def expect(self, now_s: float = _NEVER) -> None:
        """Record a reading, or that readings begin now; without a time, that none will come."""
        self._expected_s = now_s

    def asking(self, now_s: float) -> None:
        """Record a question that is sent now."""
        if self._asked == 0:
            self.first_asked_s = now_s
        self._asked += 1

    def unanswered(self, now_s: float) -> None:
        """Record that no answer came to it."""
        self.ask_s = now_s + min(_ASK_EVERY_S, _ASK_LATER_S * (self._asked - 1))

    def unplug(self, now_s: float) -> None:
        """Record that the port is not there any more."""
        self._unplugged_s = self.reopen_s = now_s
        self._wait_s = _REOPEN_S
        self.is_open = self._refused = False

    def unplugged_for_s(self, now_s: float) -> float:
        """Return for how long the port has been unplugged."""
        return now_s - self._unplugged_s

    def reopened(self) -> None:
        """Record that the port is open again."""
        self.is_open, self.tries = True, 0

    def look_later(self, now_s: float, refused: bool) -> bool:
        """Record that the board was not there; return whether another one is, for the first time.

        Parameters
        ----------
        now_s : float
        refused : bool
            Whether another board is in its place.

        Returns
        -------
        bool
        """
        newly, self._refused = refused and not self._refused, refused
        self.is_open = False
        self.reopen_s = now_s + self._wait_s
        self._wait_s = min(2 * self._wait_s, _REOPEN_MOST_S)
        return newly

    def plug(self, now_s: float) -> None:
        """Record that the board is back: whether it has restarted is asked at once."""
        self._unplugged_s = _NEVER
        self.ask_s = self._expected_s = now_s
