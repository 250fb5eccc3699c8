"""Drops what a person typed before a question, so that it does not answer the question."""

import sys
from contextlib import suppress
from typing import TextIO

if sys.platform == "win32":
    import msvcrt
else:
    import termios


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
