"""Reports exceptions of threads and callbacks in one line each, and lets the thread continue."""

import contextlib
from collections.abc import Callable

from ..errors import printable
from .reports import Reports, is_limit

_TEXT_MAX = 200


class Guarded:
    """Wraps a function for a thread or a callback: its exceptions are reported, not raised.

    Without this class, an exception would end the thread. `name` is the subject of the message,
    such as "the reader of a board". `on_failure` gets each message; it is also printed on stderr,
    at most every 10 s.
    """

    def __init__(self, function: Callable, name: str, on_failure: Callable = lambda text: None):
        self._function, self._name, self._on_failure = function, name, on_failure
        self._reports = Reports()

    def __call__(self, *arguments):
        """Call the function and return its result, or None after an exception."""
        try:
            return self._function(*arguments)
        except Exception as error:
            self.failed(error)

    def failed(self, error: Exception) -> None:
        """Report an exception; never raise one, even when memory is short."""
        with contextlib.suppress(Exception):
            sentence = sentence_of(self._name, error)
            try:
                if not is_limit(error):
                    self._reports.say(None, sentence)
            finally:
                self._on_failure(sentence)


def sentence_of(name: str, error: Exception) -> str:
    """Return a message about an exception in one printable line: what failed, where and why.

    `name` is the subject, such as "the reader of a board". The length is bounded.
    """
    trace = error.__traceback__
    while trace.tb_next:
        trace = trace.tb_next
    place = f"{trace.tb_frame.f_globals.get('__name__')}, line {trace.tb_lineno}"
    what = printable(f"{type(error).__name__}: {error}"[:_TEXT_MAX])
    return f"{name} failed: please report this fault ({place}, {what})"
