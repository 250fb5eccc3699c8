"""What a process with a virtual board prints when it has started, or why it has not."""

from __future__ import annotations

import contextlib
import json
import os
import sys


def report(message: dict) -> None:
    """Print one line of JSON, unbuffered, so that the interpreter's end has nothing to flush.

    Whoever started the process may have ended; then standard input closes too.
    """
    with contextlib.suppress(BrokenPipeError):
        os.write(sys.stdout.fileno(), json.dumps(message).encode() + b"\n")
