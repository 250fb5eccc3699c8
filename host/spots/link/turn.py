"""A fair lock with which several threads share one link."""

import threading
from collections import deque
from collections.abc import Callable


class Turn:
    """A reentrant lock that threads acquire in the order of their requests.

    A thread that reads a link in a loop acquires the lock again right after each release. With an
    ordinary lock, other threads would starve.
    """

    def __init__(self):
        self._changed = threading.Condition()
        self._queue: deque[object] = deque()
        self._owner = self._depth = 0

    def __enter__(self) -> None:
        self.take()

    def __exit__(self, *exception: object) -> None:
        self.give()

    def take(
        self, timeout_s: float | None = None, unless: Callable[[], bool] = lambda: False
    ) -> bool:
        """Acquire the lock; stop waiting for it after a timeout, or if ``unless()`` is true.

        ``unless()`` is called at each release of the lock and at each `wake`. Returned is whether
        the lock was acquired.
        """
        me = threading.get_ident()
        if self._owner == me:
            self._depth += 1
            return True
        ticket = object()
        with self._changed:
            try:
                self._queue.append(ticket)
                self._changed.wait_for(lambda: self._is_next(ticket) or unless(), timeout_s)
                if not self._is_next(ticket):
                    return False
                self._owner, self._depth = me, 1
                return True
            finally:
                # Ctrl-C may interrupt any line: a ticket that stays would block the lock for ever.
                if ticket in self._queue:
                    self._queue.remove(ticket)
                self._changed.notify_all()

    def give(self) -> None:
        """Release the lock; call this one time for each successful `take`."""
        with self._changed:
            self._depth -= 1
            if not self._depth:
                self._owner = 0
                self._changed.notify_all()

    def wake(self) -> None:
        """Let each thread that waits in `take` call its function `unless` again."""
        with self._changed:
            self._changed.notify_all()

    def _is_next(self, ticket: object) -> bool:
        return not self._depth and self._queue[0] is ticket
