"""A key of the terminal that works without Enter while a command shows readings."""

import os
import sys
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from itertools import count

from ..errors import SpotsError
from ..link.board import Board

if sys.platform == "win32":
    import msvcrt
else:
    import select
    import termios
    import tty

_LOOK_S = 0.1  # time between two looks at the keyboard


@contextmanager
def hotkey(key: str, action: Callable[[], None]) -> Iterator[None]:
    """Call ``action()``, in another thread, whenever a key is pressed; needs a terminal.

    Without a terminal as standard input, this does nothing.
    """
    try:
        if not sys.stdin.isatty():
            yield
            return
        number = sys.stdin.fileno()
    except (AttributeError, ValueError, OSError):  # standard input is closed
        yield
        return
    before = None if sys.platform == "win32" else termios.tcgetattr(number)
    ended = threading.Event()
    thread = threading.Thread(target=_look, args=(number, key, action, ended), daemon=True)
    try:
        if before is not None:
            tty.setcbreak(number)
        thread.start()
        yield
    finally:
        ended.set()
        if before is not None:
            termios.tcsetattr(number, termios.TCSADRAIN, before)


def _look(number: int, key: str, action: Callable[[], None], ended: threading.Event) -> None:
    with suppress(OSError, ValueError):
        while not ended.is_set():
            if _pressed(number) == key:
                action()


def _pressed(number: int) -> str:
    if sys.platform == "win32":
        if msvcrt.kbhit():
            return msvcrt.getwch()
        threading.Event().wait(_LOOK_S)
        return ""
    if select.select([number], [], [], _LOOK_S)[0]:
        return os.read(number, 1).decode(errors="replace")
    return ""


def marker(board: Board) -> Callable[[], None]:
    """Return a function that marks the present moment in the recordings of a board."""
    numbers = count(1)

    def mark() -> None:
        with suppress(SpotsError):  # the recording has ended
            board.mark(f"mark {next(numbers)}")

    return mark
