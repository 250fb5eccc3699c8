"""Exceptions in threads and callbacks: reported as one sentence; the thread goes on."""

from __future__ import annotations

import contextlib
import sys
import time
from collections.abc import Callable

from .errors import printable

_REPORT_EVERY_S = 10.0
_TEXT_MAX = 200


class Guarded:
    """A function that reports an exception instead of raising it, for threads and callbacks.

    An exception that leaves a thread ends it, and nobody who waits for the thread notices.

    Parameters
    ----------
    function : callable
    name : str
        What it does, as the subject of the sentence: "the reader of a board".
    on_failure : callable, optional
        Gets each sentence. It goes to stderr, too, but at most every 10 s.
    """

    def __init__(
        self,
        function: Callable,
        name: str,
        on_failure: Callable[[str], None] = lambda sentence: None,
    ):
        self._function, self._name, self._on_failure = function, name, on_failure
        self._due_s = float("-inf")

    def __call__(self, *arguments):
        """Return what the function returns; None if it raises."""
        try:
            return self._function(*arguments)
        except Exception as error:
            self.failed(error)
            return None

    def failed(self, error: Exception) -> None:
        """Report an exception; never raises one itself, even where memory is short."""
        with contextlib.suppress(Exception):
            sentence = sentence_of(self._name, error)
            try:
                self._print(sentence)
            finally:
                self._on_failure(sentence)

    def _print(self, sentence: str) -> None:
        now_s = time.monotonic()
        if now_s >= self._due_s:
            self._due_s = now_s + _REPORT_EVERY_S
            print(f"spots: {sentence}", file=sys.stderr, flush=True)


def sentence_of(name: str, error: Exception) -> str:
    """Return what failed, where and why, as one line.

    Parameters
    ----------
    name : str
        What failed, as the subject of the sentence: "the reader of a board".
    error : Exception
        As it was caught, with its traceback.

    Returns
    -------
    str
        Printable, of bounded length.
    """
    trace = error.__traceback__
    while trace.tb_next:
        trace = trace.tb_next
    place = f"{trace.tb_frame.f_globals.get('__name__')}, line {trace.tb_lineno}"
    what = printable(f"{type(error).__name__}: {error}"[:_TEXT_MAX])
    return f"{name} failed and goes on: please report this fault ({place}, {what})"
