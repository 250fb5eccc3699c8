"""Virtual boards in real time for the tests, and checks of their messages."""

from __future__ import annotations

import contextlib
import os

from spots.cli import main
from spots_device.board.store import Store
from spots_sim.demo.virtual import VIRTUAL, start_simulator

DEADLINE_S = 20.0


def store(folder, **parts):
    """Store lines in a board's file system, by name of the part, such as ``settings1``."""
    there = os.getcwd()
    os.chdir(folder)
    try:
        Store().save(parts.items())
    finally:
        os.chdir(there)


@contextlib.contextmanager
def running(folder, board=VIRTUAL):
    """Start a virtual board whose file system is `folder`, for a `with` block.

    Yields a dict: ``port`` is the name of the serial port, and ``console`` that of CircuitPython's
    console.
    """
    start, end = start_simulator("default", "demo", 0, str(folder), board)
    try:
        yield start
    finally:
        end()


@contextlib.contextmanager
def virtual_board(folder):
    """Start a virtual board as `running` does; yield the name of its only port."""
    with running(folder) as start:
        yield start["port"]


def until(link, wanted):
    """Read from a link until `wanted` has arrived; return all bytes read."""
    received = b""
    end_s = link.now_s() + DEADLINE_S
    while wanted not in received:
        assert link.now_s() < end_s, received[-300:]
        received += link.read(0.1)
    return received


def refused(capsys, *arguments):
    """Run ``spots`` with arguments that it must refuse with one line; return this line."""
    assert main(list(arguments)) == 2
    error = capsys.readouterr().err
    assert error.startswith("spots: ")
    assert error.count("\n") == 1
    return error
