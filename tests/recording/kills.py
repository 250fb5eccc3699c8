"""A process that records and reports its frames, to be killed by a test."""

from __future__ import annotations

from reels import recorder
from test_frames import touch

FRAMES = 1 << 16


def pieces():
    """Yield the frames of a recording without end, 1 to 4 at a time, like reads of a busy link."""
    i = 0
    while i < FRAMES:
        size = 1 + i % 4
        yield b"".join(touch(j, 1000 + j) for j in range(i, i + size))
        i += size


def run(path, told):
    """Record without end; send the number of delivered frames after each read."""
    tap = recorder(path, pieces(), step_s=0.003, rotate_bytes=3000)
    handed = 0
    while True:
        handed += tap.read(1.0).count(b"\0")
        told.send(handed)
