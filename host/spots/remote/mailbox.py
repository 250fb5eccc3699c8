"""Messages between the thread that gets them and the one that reads them, in bounded memory."""

from __future__ import annotations

import sys
import threading
from collections import deque
from typing import Any

WAITING_BYTES_MAX = 1 << 19
MESSAGE_BYTES_MAX = 1 << 16
# Of a message without its label and its bytes: the tuple of both, and its place in the queue.
_OVERHEAD_BYTES = sys.getsizeof((None, None)) + 8


class Mailbox:
    """Keeps the newest messages; whoever reads too slowly misses the oldest.

    Attributes
    ----------
    changed : threading.Condition
        Notified with every message, and by whoever changes what a reader waits for besides.
    dropped : int
        Messages that were dropped unread.
    """

    def __init__(self):
        self.changed = threading.Condition()
        self.dropped = 0
        self._messages: deque[tuple[Any, bytes]] = deque()
        self._bytes = 0

    def __len__(self) -> int:
        return len(self._messages)

    def put(self, label: Any, data: Any) -> None:
        """Add a message and what it is labelled with.

        Parameters
        ----------
        label : hashable
        data : bytes or zenoh.ZBytes
            Copied only if it is no longer than any message of a publisher.
        """
        with self.changed:
            if len(data) > MESSAGE_BYTES_MAX:
                self.dropped += 1
                return
            message = label, bytes(data)
            self._messages.append(message)
            self._bytes += _size(message)
            while self._bytes > WAITING_BYTES_MAX:
                self._take()
                self.dropped += 1
            self.changed.notify_all()

    def take(self) -> tuple[Any, bytes]:
        """Return the oldest message; IndexError if the mailbox is empty."""
        with self.changed:
            return self._take()

    def clear(self) -> None:
        """Forget what waits."""
        with self.changed:
            self._messages.clear()
            self._bytes = 0

    def _take(self) -> tuple[Any, bytes]:
        message = self._messages.popleft()
        self._bytes -= _size(message)
        return message


def _size(message: tuple[Any, bytes]) -> int:
    return _OVERHEAD_BYTES + sum(map(sys.getsizeof, message))
