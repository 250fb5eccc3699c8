"""The CRC of frames on CircuitPython, computed by a function in C."""

from binascii import crc32
from struct import pack_into

from ..runtime.circuitpython import view_of
from . import kernel

_MAX_31_BITS = 0x7FFFFFFF


def fast_crc(data, size):
    """Write a CRC-32 like `kernel.add_crc`, but faster.

    For a frame it takes 0.1 ms instead of 0.5 ms, and allocates up to 32 bytes for a long integer.
    """
    crc = crc32(view_of(data, size))
    pack_into("<HH", data, size, hash(crc) & 0xFFFF, _high_half(crc))


def _high_half(value):
    # `hash` returns the lowest 31 bits of an integer and, unlike `&` and `>>`, allocates nothing.
    return hash(value) >> 16 & 0x7FFF | (0x8000 if value > _MAX_31_BITS else 0)


def speed_up():
    """Replace the function `add_crc` of `kernel` by `fast_crc`."""
    kernel.add_crc = fast_crc
