"""The state of the page: the newest of every part, and the last events in order.

One thread writes, any number of clients read. A client is a pair of numbers, so that a slow one
costs nothing and loses what was overwritten meanwhile.
"""

from __future__ import annotations

import threading
from collections import deque
from collections.abc import Callable
from typing import Any, NamedTuple

# A client that falls behind by more key events and gestures than this loses the oldest.
EVENTS_KEPT = 512


class Cursor(NamedTuple):
    """How far a client has read.

    Attributes
    ----------
    version : int
        Of the parts.
    events : int
        How many had been added.
    """

    version: int
    events: int


class PageState:
    """Parts by name, and events.

    Parameters
    ----------
    on_change : callable, optional
        Called without arguments by the thread that wrote.
    """

    def __init__(self, on_change: Callable[[], None] = lambda: None):
        self.on_change = on_change
        self._lock = threading.Lock()
        self._parts: dict[str, tuple[int, Any]] = {}
        self._version = 0
        self._events: deque[dict] = deque(maxlen=EVENTS_KEPT)
        self._added = 0

    def put(self, name: str, value: Any) -> None:
        """Replace a part; None takes it away from the page.

        Parameters
        ----------
        name : str
            Of the part, see docs/page.md.
        value : object
            What JSON can hold, or None.
        """
        with self._lock:
            self._version += 1
            self._parts[name] = self._version, value
        self.on_change()

    def add_event(self, event: dict) -> None:
        """Append an event."""
        with self._lock:
            self._events.append(event)
            self._added += 1
        self.on_change()

    def begin(self) -> Cursor:
        """Return the cursor of a client that knows no part and wants the events from now on."""
        with self._lock:
            return Cursor(0, self._added)

    def since(self, cursor: Cursor) -> tuple[Cursor, dict]:
        """Return what a client does not know yet, and its cursor after that.

        Returns
        -------
        cursor : Cursor
        news : dict
            Parts that changed, by name; ``events``, a list, if there are any; ``missed``, how
            many events were dropped before these, if any were.
        """
        with self._lock:
            news = {
                name: value
                for name, (version, value) in self._parts.items()
                if version > cursor.version
            }
            new = self._added - cursor.events
            kept = min(new, len(self._events))
            if kept:
                news["events"] = [self._events[i] for i in range(-kept, 0)]
            if new > kept:
                news["missed"] = new - kept
            return Cursor(self._version, self._added), news
