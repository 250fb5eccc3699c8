"""Streams of valid frames, which the tests of damaged streams use."""

from __future__ import annotations

import json
import struct
import zlib

import numpy as np
from cobs import cobs


def encoded(payload: bytes) -> bytes:
    return cobs.encode(payload + struct.pack("<I", zlib.crc32(payload))) + b"\0"


def frames(count: int, seed: int = 0, texts: bool = True) -> list[bytes]:
    """Return encoded frames of four kinds as a board sends them, mostly TOUCH.

    Parameters
    ----------
    count : int
        Number of frames.
    seed : int
        Random seed of kinds and contents.
    texts : bool
        Whether to include SPECTRUM, KEY and TEXT frames; otherwise all frames are TOUCH.
    """
    rng = np.random.default_rng(seed)
    made = []
    for i in range(count):
        header = (i, 10_000 * i + int(rng.integers(0, 100)))
        kind = rng.random()
        if kind < 0.7 or not texts:
            body = (int(rng.normal(0, 2e6)), int(rng.normal(8e6, 1e6)))
            body += (int(rng.integers(0, 85_000)), int(rng.integers(0, 9000)))
            payload = struct.pack("<BHIBiiiH", 1, *header, int(rng.integers(0, 16)), *body)
        elif kind < 0.9:
            payload = struct.pack("<BHIBB6H", 2, *header, 9, 9, *rng.integers(0, 3597, 6).tolist())
        elif kind < 0.97:
            usage = 30 + int(rng.integers(0, 10))
            payload = struct.pack("<BHIBHBB", 4, *header, 7, usage, 0, i % 2)
        else:
            text = {"re": "sync", "t_us": header[1]}
            payload = struct.pack("<BHI", 3, *header) + json.dumps(text).encode()
        made.append(encoded(payload))
    return made
