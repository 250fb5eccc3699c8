"""Shows the cursor of the terminal while a program that hides it is suspended."""

import os
from contextlib import AbstractContextManager, nullcontext, suppress

from rich.console import Console

from .signals import around_stops

_SHOW_CURSOR, _HIDE_CURSOR = b"\x1b[?25h", b"\x1b[?25l"


def cursor_shown(console: Console) -> AbstractContextManager[None]:
    """Return a context manager for a display that hides the cursor: Ctrl-Z shows the cursor."""

    def write(code: bytes) -> None:
        # Not by the console: the signal may have interrupted its write.
        with suppress(OSError, ValueError):
            os.write(console.file.fileno(), code)

    if not console.is_terminal:
        return nullcontext()
    return around_stops(lambda: write(_SHOW_CURSOR), lambda: write(_HIDE_CURSOR))
