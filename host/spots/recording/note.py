"""Notes: entries that a recorder adds, encoded like the frames of a board."""

from __future__ import annotations

import json
import struct
import zlib

from cobs import cobs

from spots_device.frame import HEADER

from ..link.frames import NOTE

_HEADER = struct.Struct(HEADER)
_CRC = struct.Struct("<I")


def note(since_us: int, content: dict | None = None) -> bytes:
    """Encode a note.

    Parameters
    ----------
    since_us : int
        Host time since the recording began, in us, 0 to 2**48 - 1.
    content : dict, optional
        Content of the note, up to `spots_device.frame.TEXT_MAX` bytes as JSON.

    Returns
    -------
    bytes
    """
    low, high, sequence = (since_us >> shift & 0xFFFF for shift in (0, 16, 32))
    payload = _HEADER.pack(NOTE, sequence, low, high)
    if content is not None:
        payload += json.dumps(content, separators=(",", ":")).encode()
    return cobs.encode(payload + _CRC.pack(zlib.crc32(payload))) + b"\0"
