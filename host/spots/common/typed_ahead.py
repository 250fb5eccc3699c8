"""Drops what a person typed before a question, and hides it while a picture is shown."""

import os
import sys
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from typing import TextIO

from .signals import around_stops

if sys.platform == "win32":
    import msvcrt
else:
    import termios

    _GONE = (AttributeError, ValueError, OSError, termios.error)


def drop(stdin: TextIO | None = None) -> None:
    """Discard the keys that were typed at a terminal but not read yet; call this before a question.

    Lines from a pipe or a file are kept: a script writes all its answers at once.
    """
    stdin = stdin or sys.stdin
    # A closed standard input is None, or raises ValueError; the read of the answer reports it.
    with suppress(AttributeError, ValueError, OSError):
        if not stdin.isatty():
            return
        if sys.platform == "win32":
            while msvcrt.kbhit():
                msvcrt.getwch()
        else:
            with suppress(termios.error):
                termios.tcflush(stdin.fileno(), termios.TCIFLUSH)


@contextmanager
def unechoed() -> Iterator[None]:
    """Echo no keys on the terminal: an Enter would scroll a picture that is redrawn in place."""
    if sys.platform == "win32" or not _echoes():
        yield
        return
    with around_stops(lambda: _echo(True), lambda: _echo(False)):
        try:
            _echo(False)
            yield
        finally:
            _echo(True)


def _echoes() -> bool:
    with suppress(*_GONE):
        return bool(termios.tcgetattr(sys.stdin.fileno())[3] & termios.ECHO)
    return False


def _echo(on: bool) -> None:
    with suppress(*_GONE):
        number = sys.stdin.fileno()
        with suppress(OSError):  # a terminal without job control
            if os.tcgetpgrp(number) != os.getpgrp():
                return  # a background process that sets its terminal is stopped
        now = termios.tcgetattr(number)
        now[3] = now[3] | termios.ECHO if on else now[3] & ~termios.ECHO
        termios.tcsetattr(number, termios.TCSANOW, now)
