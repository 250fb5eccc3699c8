"""Streams of valid frames, which the tests of damaged streams use."""

from __future__ import annotations

import json
import struct

import numpy as np

from support.frames import encoded


def frames(count: int, seed: int = 0, texts: bool = True, first: int = 0) -> list[bytes]:
    """Return encoded frames of four kinds as a board sends them, mostly TOUCH.

    Parameters
    ----------
    count : int
        Number of frames.
    seed : int
        Random seed of kinds and contents.
    texts : bool
        Whether to include SPECTRUM, KEY and TEXT frames; otherwise all frames are TOUCH.
    first : int
        Number of the first frame; a frame contains it modulo 2**16.
    """
    rng = np.random.default_rng(seed)
    made = []
    for i in range(first, first + count):
        header = (i & 0xFFFF, 10_000 * i + int(rng.integers(0, 100)))
        kind = rng.random()
        if kind < 0.7 or not texts:
            body = (int(rng.normal(0, 2e6)), int(rng.normal(8e6, 1e6)))
            body += (int(rng.integers(0, 85_000)), int(rng.integers(0, 9000)))
            payload = struct.pack("<BHIBiiiH", 1, *header, int(rng.integers(0, 16)), *body)
        elif kind < 0.9:
            words = *rng.integers(0, 3597, 12).tolist(), 24_500, 1
            payload = struct.pack("<BHIBB6H6IiB", 2, *header, 9, 9, *words)
        elif kind < 0.97:
            usage = 30 + int(rng.integers(0, 10))
            payload = struct.pack("<BHIBHBB", 4, *header, 7, usage, 0, i % 2)
        else:
            text = {"re": "sync", "t_us": header[1]}
            payload = struct.pack("<BHI", 3, *header) + json.dumps(text).encode()
        made.append(encoded(payload))
    return made


def damaged(piece, count, rng):
    """Return `count` damaged variants of a frame in a row.

    In each variant 2 to 8 bytes are changed, lost or repeated, or other bytes are inserted.
    """
    size = len(piece) - 1  # the delimiter stays
    rows = np.tile(np.frombuffer(piece, np.uint8), (count, 1))
    where = np.argsort(rng.random((count, size)), axis=1)[:, :8]
    ways = rng.integers(0, 4, where.shape)
    ways[np.arange(8) >= rng.integers(2, 9, count)[:, None]] = -1
    way = np.full(rows.shape, -1)
    np.put_along_axis(way, where, ways, axis=1)
    times = np.select([way == 1, way >= 2], [0, 2], 1)
    noise = rng.integers(1, 256, rows.shape, dtype=np.uint8)
    rows[way == 0] ^= noise[way == 0]
    out = np.repeat(rows.ravel(), times.ravel())
    # An inserted byte follows a byte of the frame, and differs from it.
    first = np.cumsum(times.ravel()) - times.ravel()
    inserted = np.flatnonzero((way == 3).ravel())
    out[first[inserted] + 1] ^= noise.ravel()[inserted]
    return out.tobytes()
