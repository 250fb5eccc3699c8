"""The unique id of a virtual board: two sensor files, two boards."""

from __future__ import annotations

import hashlib

import msgspec

from .files import SensorFile


def board_id(sensor: SensorFile) -> str:
    """Return 8 bytes in hexadecimal, the same for the same sensor however it changed."""
    return hashlib.sha256(msgspec.json.encode(sensor.unchanged())).hexdigest()[:16]
