"""Encoded frames of a host's tests: one reading, or a stream of them."""

import struct
import zlib

from cobs import cobs


def encoded(payload):
    crc = struct.pack("<I", zlib.crc32(payload))
    return cobs.encode(payload + crc) + b"\0"


def touch(sequence, position_um=42_000, kind=0x01):
    fields = (kind, sequence & 0xFFFF, 1000 * sequence, 0x09, -5, 7, position_um, 1500)
    return encoded(struct.pack("<BHIBiiiH", *fields))


def stream(count, start=0):
    return [touch(i, position_um=1000 + i) for i in range(start, start + count)]
