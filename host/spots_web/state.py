"""State of the web UI: the newest values by name (the parts), and the last events in order.

Any number of threads write, and any number of clients (browser windows) read. Only two numbers (a
`Cursor`) are stored for each client, even for a slow client. A client misses values that were
overwritten before the client read them.
"""

import threading
from collections import deque
from typing import Any, NamedTuple

# Number of stored events. A slow client misses older events.
EVENTS_KEPT = 512


class Cursor(NamedTuple):
    """What a client of the web UI has read: numbers of changes of parts, and of events."""

    version: int
    events: int


class PageState:
    """State of the web UI: values by name, called parts, and events; docs/extend/web-messages.md.

    Attributes
    ----------
    on_change : callable
        Called without arguments after each change, in the thread that writes.
    """

    def __init__(self):
        self.on_change = lambda: None
        self._lock = threading.Lock()
        self._parts: dict[str, tuple[int, Any]] = {}
        self._version = 0
        self._events: deque[dict] = deque(maxlen=EVENTS_KEPT)
        self._added = 0

    def put(self, name: str, value: Any) -> None:
        """Replace the value of a part.

        Parameters
        ----------
        name : str
            Name of the part, see docs/extend/web-messages.md.
        value : object
            New value, of JSON types; None removes the part from the web UI.
        """
        with self._lock:
            self._version += 1
            self._parts[name] = self._version, value
        self.on_change()

    def add_event(self, event: dict) -> None:
        """Append an event, such as a pressed key or a gesture, for the browsers."""
        with self._lock:
            self._events.append(event)
            self._added += 1
        self.on_change()

    def begin(self) -> Cursor:
        """Return the cursor of a new client: it gets the whole state, and events from now on."""
        with self._lock:
            return Cursor(0, self._added)

    def since(self, cursor: Cursor) -> tuple[Cursor, dict]:
        """Return a client's new cursor, and the changes since its previous cursor.

        Returns
        -------
        cursor : Cursor
            Cursor for the next call.
        news : dict
            Changed parts by name. If there are new events, ``events`` is a list of them. If events
            were dropped before this client read them, ``missed`` is their number.
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


class OtherStrip(PageState):
    """Shows only the latest reading and warning of a strip, if another strip is shown in detail.

    All objects of a board share the dict `strips`, by number of the strip, which is the part
    ``beside`` of the state.
    """

    def __init__(self, state: PageState, sensor: int, strips: dict[int, dict]):
        super().__init__()
        self._state, self._sensor, self._strips = state, sensor, strips

    def put(self, name: str, value: Any) -> None:
        if name in ("touch", "untrusted"):
            self._strips[self._sensor] = {**self._strips.get(self._sensor, {}), name: value}
            self._state.put("beside", dict(self._strips))  # a copy for the server's thread

    def add_event(self, event: dict) -> None:
        pass
