"""Measures the time to read a recording as arrays, and the same readings as lines of JSON."""

from __future__ import annotations

from pathlib import Path
from tempfile import TemporaryDirectory

from spots.link.decoder import Decoder, checked, framed
from spots.recording.arrays import read_arrays
from spots.recording.header import VERSION, Clock, Header, encoded
from spots_device import PROTOCOL

from . import host

_ROUNDS = 5
_READINGS = 100_000
_HEADER = Header(
    recording=VERSION,
    program="bench",
    set="bench",
    part=0,
    host_s=0.0,
    utc_s=0.0,
    info={"protocol": PROTOCOL, "board": "bench", "runtime": "cpython", "channels": []},
    clock=Clock(last_us=0, low_s=0.0, high_s=0.0),
)


def measure(stream: bytes) -> dict:
    """Time `read_arrays` of a recording, alternating with `json.loads` of the same readings.

    Parameters
    ----------
    stream : bytes
        Complete TOUCH frames, which are repeated to get about 100,000 readings.

    Returns
    -------
    dict
        Readings per second of processor time: ``readings_per_s`` from the recording,
        ``json_readings_per_s`` from JSON; and ``rate_ratio``, the first divided by the second.
    """
    touches = Decoder().feed(stream)
    copies = -(-_READINGS // len(touches))
    count = copies * len(touches)
    lines = host.pieces(b"".join(map(host.line, touches)) * copies)
    seconds = {"arrays": [], "json": []}
    with TemporaryDirectory() as folder:
        path = Path(folder) / "bench.spots"
        path.write_bytes(encoded(_HEADER) + _numbered(stream, copies))
        for _ in range(_ROUNDS):
            seconds["arrays"].append(host.timed_s(path, _read, count))
            seconds["json"].append(host.timed_s(lines, host.loads, count))
    # The shortest of several times has the least interruption by other processes.
    arrays_s, json_s = (min(times) for times in seconds.values())
    return {
        "readings_per_s": round(count / arrays_s),
        "json_readings_per_s": round(count / json_s),
        "rate_ratio": round(json_s / arrays_s, 3),
    }


def _read(path: Path) -> int:
    return len(read_arrays(path).touches)


def _numbered(stream: bytes, copies: int) -> bytes:
    """Repeat frames with the sequence of one board, in which no frame is lost."""
    payloads = [bytearray(checked(piece) or b"") for piece in stream.split(b"\0") if piece]
    found = []
    for number in range(copies * len(payloads)):
        payload = payloads[number % len(payloads)]
        payload[1:3] = (number & 0xFFFF).to_bytes(2, "little")
        found.append(framed(bytes(payload)))
    return b"\0".join([*found, b""])
