"""A process that records and reports the number of its frames; a test kills it."""

from __future__ import annotations

from support.frames import touch
from support.reels import recorder

FRAMES = 1 << 16


def pieces():
    """Yield blocks of 1 to 4 frames, like reads of a link; far more than a test needs."""
    i = 0
    while i < FRAMES:
        size = 1 + i % 4
        yield b"".join(touch(j, 1000 + j) for j in range(i, i + size))
        i += size


def run(path, told):
    """Record until the process is killed.

    After each read, send the number of frames delivered up to then over the pipe `told`.
    """
    tap = recorder(path, pieces(), step_s=0.003, rotate_bytes=3000)
    handed = 0
    while True:
        handed += tap.read(1.0).count(b"\0")
        told.send(handed)
