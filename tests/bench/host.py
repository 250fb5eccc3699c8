"""Measures the time to decode a reading on the host: as a frame, and as a line of JSON."""

from __future__ import annotations

import json
from collections.abc import Callable
from statistics import median
from time import process_time

from spots.link.decoder import Decoder
from spots.link.frames import Touch

_ROUNDS = 15
_COPIES = 16
_PIECE_BYTES = 4096


def measure(stream: bytes) -> dict:
    """Time the decoders of frames and of JSON alternately, with the same readings.

    Parameters
    ----------
    stream : bytes
        Complete TOUCH frames.

    Returns
    -------
    dict
        ``spots`` and ``json``: readings per second of processor time, and bytes per reading, of
        frames and of JSON. ``rate_ratio``: the first rate divided by the second.
    """
    touches = Decoder().feed(stream)
    lines = b"".join(line(touch) for touch in touches)
    contents = {"spots": (stream * _COPIES, _decode), "json": (lines * _COPIES, loads)}
    cut = {name: (pieces(data), read) for name, (data, read) in contents.items()}
    seconds = {name: [] for name in cut}
    count = len(touches) * _COPIES
    for _ in range(_ROUNDS):
        for name, (data, read) in cut.items():
            seconds[name].append(timed_s(data, read, count))
    rates_Hz = {name: count / median(times) for name, times in seconds.items()}
    figures = {
        name: {
            "readings_per_s": round(rates_Hz[name]),
            "bytes_per_reading": len(data) / count,
        }
        for name, (data, _) in contents.items()
    }
    figures["rate_ratio"] = round(rates_Hz["spots"] / rates_Hz["json"], 3)
    return figures


def line(touch: Touch) -> bytes:
    """Return a reading as a line of JSON."""
    fields = touch._asdict()
    del fields["time_s"], fields["sigma_um"]  # added by the host, not sent by the board
    return json.dumps(fields, separators=(",", ":")).encode() + b"\n"


def pieces(data: bytes) -> list[bytes]:
    """Divide bytes into blocks as a serial port delivers them."""
    return [data[i : i + _PIECE_BYTES] for i in range(0, len(data), _PIECE_BYTES)]


def timed_s(data: object, read: Callable, count: int) -> float:
    """Return the processor time of ``read(data)`` in s; it must return `count` readings."""
    began_s = process_time()
    found = read(data)
    elapsed_s = process_time() - began_s
    if found != count:
        raise AssertionError(f"{found} readings decoded of {count}")
    return elapsed_s


def _decode(pieces: list[bytes]) -> int:
    decoder = Decoder()
    return sum(len(decoder.feed(piece)) for piece in pieces)


def loads(pieces: list[bytes]) -> int:
    """Parse each line of JSON in the pieces, and return the number of lines."""
    found, rest = 0, b""
    for piece in pieces:
        *lines, rest = (rest + piece).split(b"\n")
        found += len([json.loads(line) for line in lines])
    return found
