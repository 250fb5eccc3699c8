"""Start and end of a virtual board's process, and the board's pseudo-terminal.

Such a process ends at a byte on its standard input, or at the end of the input. The byte is needed:
a program that was forked from the parent keeps the input open.
"""

from __future__ import annotations

import contextlib
import json
import os
import select
import subprocess
import sys
import threading
import time
from collections.abc import Callable

_PARENT_EVERY_S = 0.5  # interval between two checks of the parent
_END_S = 5.0  # time that the board has to end cleanly after its parent has ended
_WAIT_S = 8.0  # longest wait for the process that ends; more than `_END_S`


def report(message: dict) -> None:
    """Print one line of JSON without buffering: the ports of the board, or an error.

    A closed pipe is not an error: the parent may have ended, and then standard input closes too.
    """
    with contextlib.suppress(BrokenPipeError):
        os.write(sys.stdout.fileno(), json.dumps(message).encode() + b"\n")


def end(process: subprocess.Popen, parent: int) -> None:
    """End a process that waits for its standard input, and wait for its end; kill it after 8 s.

    In a program that was forked from `parent`, do nothing. A second call has no effect.
    """
    if os.getpid() != parent:
        return
    with contextlib.suppress(OSError, ValueError):  # it has ended; the pipe is closed
        os.write(process.stdin.fileno(), b"\n")
    process.stdin.close()
    try:
        process.wait(_WAIT_S)
    except subprocess.TimeoutExpired:
        process.kill()
        process.wait()
    if process.stdout:
        process.stdout.close()  # only now, because a starting process still writes to it


def when_parent_ends(action: Callable[[], object]) -> None:
    """Call a function as soon as standard input gets a byte or closes, or the parent ends.

    A separate thread waits and makes the call. If the process still runs 5 s after the call, the
    thread ends the process. An error in the thread also ends the process.
    """
    parent, stdin = os.getppid(), sys.stdin.fileno()

    def watch():
        try:
            _await_end(parent, stdin)
        finally:
            action()
            time.sleep(_END_S)
            os._exit(1)

    threading.Thread(target=watch, daemon=True).start()


def _await_end(parent: int, stdin: int) -> None:
    if sys.platform == "win32":  # `select` cannot wait for a pipe there
        os.read(stdin, 1)
        return
    # Another process may have inherited the pipe and keep it open after the parent ends.
    while os.getppid() == parent:
        if select.select([stdin], [], [], _PARENT_EVERY_S)[0]:
            return


class PseudoTerminal:
    """A pseudo-terminal as the serial port of a board; its file descriptor does not block.

    The pseudo-terminal is in raw mode, because otherwise it would echo frames to the board. This
    process keeps the host's end open, so that the board sees no hang-up between two readers.
    """

    def __init__(self):
        import pty  # not on Windows
        import tty

        self.board_end, host_end = pty.openpty()
        tty.setraw(host_end)
        os.set_blocking(self.board_end, False)
        self.name = os.ttyname(host_end)
