"""Virtual boards in real time for the tests."""

from __future__ import annotations

import contextlib

from spots.connect import VIRTUAL, start_simulator


@contextlib.contextmanager
def running(folder, board=VIRTUAL):
    """Start a virtual board on a file system folder as it is; give its ports."""
    start, end = start_simulator("default", "demo", 0, str(folder), board)
    try:
        yield start
    finally:
        end()


@contextlib.contextmanager
def virtual_board(folder):
    """As `running`; give the one port that it has."""
    with running(folder) as start:
        yield start["port"]
