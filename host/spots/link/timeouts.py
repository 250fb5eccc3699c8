"""Timeouts and back-off while a board is silent or unplugged, by the clock of the board's link.

When readings stop, `Board` sends a query to the board after `ASK_S`. Applications release their
keys after `RELEASE_S`. The state becomes stalled after `STALLED_S`. The web UI closes the board and
searches again after `SEARCH_S`. The search for an unplugged port has a growing back-off; iterators
over frames raise SpotsError after `PATIENCE_S`.
"""

import math

from ..errors import SettingError

# States of a link; a program that has not found a board yet is in the state SEARCHING.
SEARCHING, CONNECTED, STALLED = "searching", "connected", "stalled"
LOST, REFUSED = "lost", "refused"

_NEVER = float("inf")  # time of an event that is not expected
# On slow boards ASK_S, STALLED_S and SEARCH_S are at least the time of this number of readings.
_SILENT_READINGS = 3

# Times in s without a reading, see the top of this file.
ASK_S = 0.15
RELEASE_S = 0.3  # without a reading for longer, it is unknown whether a finger touches
STALLED_S = 0.5
SEARCH_S = 2.0
PATIENCE_S = 10.0  # after a restart a board needs some seconds to appear on USB

# Timeout for the reply of a board that may have restarted. A query or its reply may be damaged, so
# the second query follows immediately. Then the pause grows by a step, up to a limit.
ANSWER_S = 0.1
_ASK_LATER_S = 0.05  # the step
_ASK_EVERY_S = 0.5  # the limit

# Pause between two searches for a lost port: it doubles each time, up to a limit.
_REOPEN_S = 0.1
_REOPEN_MOST_S = 1.0
# Timeout and number of queries on a port that has appeared again.
WHO_S = 0.3
WHO_TRIES = 5


def duration_s(value: object, name: str) -> float:
    """Return an argument that is a duration in seconds; SettingError if it is not a number.

    A negative duration is valid: a program may compute it as the rest of a time that has passed.
    """
    try:
        found = float(value)  # pyright: ignore[reportArgumentType]
    except (TypeError, ValueError):
        found = math.nan
    if math.isnan(found):
        raise SettingError(f"{name} must be a number of seconds, not {value!r}")
    return found


def silent_s(least_s: float, every_s: float) -> float:
    """Return a timeout that is long enough for a slow board: three readings, or `least_s`."""
    return max(least_s, _SILENT_READINGS * every_s)


class LinkLoss:
    """State machine of a link that may stall or be unplugged.

    States: ``connected``; ``stalled`` if no expected reading has arrived for `STALLED_S`; ``lost``
    if the port is unplugged; ``refused`` while another board is on the port.

    All times are by the link's clock. `every_s` is the time from one reading to the next. `ask_s`
    is that of the next query to a silent board, `reopen_s` that of the next search for an unplugged
    board, valid only while `unplugged`, and `first_asked_s` that of the first query since the last
    frame that `heard` recorded. If `is_open`, a lost port is open again but its board is not
    identified yet; `tries` counts the queries to it.
    """

    def __init__(self, now_s: float):
        self.every_s = 0.0
        self.ask_s = self.first_asked_s = now_s
        self.is_open = self._refused = False
        self.tries = self._asked = 0
        self._expected_s = _NEVER  # when the last reading came, or the stream began
        self._unplugged_s = self.reopen_s = _NEVER

    @property
    def unplugged(self) -> bool:
        """Whether the port has disappeared, or its board is not identified yet."""
        return self._unplugged_s < _NEVER

    def state(self, now_s: float) -> str:
        """Return the state of the link: `CONNECTED`, `STALLED`, `LOST` or `REFUSED`."""
        if self.unplugged:
            return REFUSED if self._refused else LOST
        return STALLED if self.silent(now_s, STALLED_S) else CONNECTED

    def silent(self, now_s: float, least_s: float) -> bool:
        """Return whether an expected reading is late; a slow board has more time: `silent_s`."""
        return now_s - self._expected_s > silent_s(least_s, self.every_s)

    def heard(self, now_s: float) -> None:
        """Record the arrival of a frame.

        Do not call this for a KEY frame: a board sends KEY frames even when no stream is on.
        """
        self._asked = 0
        self.ask_s = now_s + silent_s(ASK_S, self.every_s)

    def expect(self, now_s: float | None) -> None:
        """Record the time of a reading or of a stream's start; with None, expect no readings."""
        self._expected_s = _NEVER if now_s is None else now_s

    def asking(self, now_s: float) -> None:
        """Record that a query is sent to the silent board now."""
        if self._asked == 0:
            self.first_asked_s = now_s
        self._asked += 1

    def unanswered(self, now_s: float) -> None:
        """Record that the board did not reply to a query; schedule the next query."""
        self.ask_s = now_s + min(_ASK_EVERY_S, _ASK_LATER_S * (self._asked - 1))

    def unplug(self, now_s: float) -> None:
        """Record that the port has disappeared."""
        self._unplugged_s = self.reopen_s = now_s
        self._wait_s = _REOPEN_S
        self.is_open = self._refused = False

    def unplugged_for_s(self, now_s: float) -> float:
        """Return for how long the port has been unplugged, in seconds."""
        return now_s - self._unplugged_s

    def reopened(self) -> None:
        """Record that the port is open again."""
        self.is_open, self.tries = True, 0

    def look_later(self, now_s: float, refused: bool) -> bool:
        """Record a failed search for the board, and schedule the next search.

        `refused` is whether the search found another board on the port. True if the state has just
        become ``refused``.
        """
        newly, self._refused = refused and not self._refused, refused
        self.is_open = False
        self.reopen_s = now_s + self._wait_s
        self._wait_s = min(2 * self._wait_s, _REOPEN_MOST_S)
        return newly

    def plug(self, now_s: float) -> None:
        """Record that the board is connected again; the next query is due now."""
        self._unplugged_s = _NEVER
        self.ask_s = self._expected_s = now_s
