"""A queue of messages between two threads, with limited memory."""

import sys
import threading
from collections import deque
from typing import Any

WAITING_BYTES_MAX = 1 << 19  # largest size of all messages in the queue
MESSAGE_BYTES_MAX = 1 << 16  # largest size of one message
# Size of a message without label and data: a tuple, and its place in the queue.
_OVERHEAD_BYTES = sys.getsizeof((None, None)) + 8


class Mailbox:
    """A queue of messages with labels. A full queue drops its oldest messages.

    `changed` is notified when a message arrives; its lock is reentrant. `dropped` counts messages
    that were too long, or for which the queue was full.
    """

    def __init__(self):
        self.changed = threading.Condition()
        self.dropped = 0
        self._messages: deque[tuple[Any, bytes]] = deque()
        self._bytes = 0

    def __len__(self) -> int:
        return len(self._messages)

    def put(self, label: Any, data: Any) -> None:
        """Add a message; one that is too long is dropped before it is copied."""
        with self.changed:
            if len(data) > MESSAGE_BYTES_MAX:
                self.dropped += 1
                return
            message = label, bytes(data)
            self._messages.append(message)
            self._bytes += _size(message)
            while self._bytes > WAITING_BYTES_MAX:
                self.take()
                self.dropped += 1
            self.changed.notify_all()

    def take(self) -> tuple[Any, bytes]:
        """Remove the oldest message and return its label and content; raise IndexError if empty."""
        with self.changed:
            message = self._messages.popleft()
            self._bytes -= _size(message)
            return message

    def clear(self) -> None:
        """Drop all messages."""
        with self.changed:
            self._messages.clear()
            self._bytes = 0


def _size(message: tuple[Any, bytes]) -> int:
    return _OVERHEAD_BYTES + sum(map(sys.getsizeof, message))
