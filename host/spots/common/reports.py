"""Prints lines about faults that may recur thousands of times: one line a cause and time."""

import errno
import sys
import time
from typing import Any

from ..errors import printable

_EVERY_S = 10.0
_CAUSES_MAX = 64
# Errors of the system when a process or the computer has too many open files or connections.
_FEW = (errno.EMFILE, errno.ENFILE, errno.ENOBUFS, errno.ENOMEM)


class Reports:
    """Prints a sentence on stderr, at most every 10 s for each cause."""

    def __init__(self):
        self._due_s: dict[object, float] = {}

    def say(self, cause: object, sentence: str) -> None:
        """Print a sentence, unless the last one of the same cause is too recent."""
        now_s = time.monotonic()
        if now_s < self._due_s.get(cause, now_s):
            return
        if cause not in self._due_s and len(self._due_s) >= _CAUSES_MAX:
            self._due_s.pop(next(iter(self._due_s)))
        self._due_s[cause] = now_s + _EVERY_S
        print(printable(f"spots: {sentence}"), file=sys.stderr, flush=True)


REPORTS = Reports()


def is_limit(error: object) -> bool:
    """Return whether an exception shows that too many files or connections are open; report it."""
    if not isinstance(error, OSError) or error.errno not in _FEW:
        return False
    REPORTS.say(
        error.errno,
        f"too many files or connections are open ({error.strerror}): close browser windows and "
        "other clients, or raise the limit of 'ulimit -n'",
    )
    return True


def on_loop_error(loop: Any, context: dict[str, Any]) -> None:
    """Handle an exception of an asyncio loop; without this, each refused connection is a traceback.

    For ``loop.set_exception_handler``.
    """
    if not is_limit(context.get("exception")):
        loop.default_exception_handler(context)
