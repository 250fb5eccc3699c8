"""Recordings that consist of several files."""

import struct

from support.frames import encoded
from support.reels import record


def at(seconds, sequence):
    t_us = 1_000_000 * seconds & 0xFFFFFFFF
    return encoded(struct.pack("<BHIBHBB", 4, sequence, t_us, 7, 30, 0, 1))


def spread(path, pieces):
    return record(path, pieces, rotate_bytes=2500, step_s=1000.0)
