"""Measures the size of a recording, and the times to write, read and export it.

``PYTHONPATH=tests .venv/bin/python -m bench.recording`` prints bytes per frame, and times relative
to decoding the same bytes without recording them.
"""

from __future__ import annotations

import json
import math
from collections.abc import Callable
from pathlib import Path
from statistics import median
from tempfile import TemporaryDirectory
from time import perf_counter

from support.touch_framer import TouchFramer

from spots.link.decoder import Decoder
from spots.recording.export import EXPORTS, export
from spots.recording.recording import Recording
from spots.recording.replay import open_recording
from spots.recording.writer import Writer
from spots_device import PROTOCOL
from spots_device.reading.decode import HEAD_SIZE, TIME_HIGH, TIME_LOW

_READINGS = 5000
_ROUNDS = 5
_RATES_HZ = (100, 360, 1000)
_INFO = {"protocol": PROTOCOL, "board": "bench", "runtime": "cpython", "channels": []}
_CLOCK = {"last_us": 0, "low_s": 0.0, "high_s": 0.0}


# flags, contrast, brightness, position_um, force_mN
_READING = 1, 3 << 18, 12 << 20, 42_500, 3_000


class _Time:
    head = [0] * HEAD_SIZE


class _Link:
    """A link that returns the frames of one reading at each `read`, at a fixed rate."""

    name = "bench"

    def __init__(self, rate_Hz: float, spectra: bool):
        self._pieces: list[bytes] = []
        framer = TouchFramer(self, _Time)
        for i in range(_READINGS):
            t_us = round(1e6 * i / rate_Hz)
            _Time.head[TIME_LOW], _Time.head[TIME_HIGH] = t_us & 0xFFFF, t_us >> 16 & 0xFFFF
            self._begun = bytearray()
            framer.touch(0, _READING)
            if spectra:
                framer.spectrum(0, 1, 9, [1000 + i] * 6, [64] * 8)
            self._pieces.append(bytes(self._begun))
        self.bytes = sum(map(len, self._pieces))
        self.frames = _READINGS * (2 if spectra else 1)
        self._rate_Hz = rate_Hz
        self._at = 0

    def write(self, buffer: bytes, size: int) -> bool:
        self._begun += buffer[:size]
        return True

    def now_s(self) -> float:
        return self._at / self._rate_Hz

    def read(self, timeout_s: float) -> bytes:
        self._at += 1
        return self._pieces[self._at - 1]

    def close(self) -> None:
        self._at = 0


def _describe() -> dict:
    return {"info": _INFO, "clock": _CLOCK}


def measure() -> dict:
    """Record, read and export the same readings.

    Returns
    -------
    dict
        ``overhead_bytes_per_frame``: bytes that a recording adds to a frame, by kinds of frames and
        rate. ``time_ratio_to_plain_decoding``: time to record, read, play or export, divided by the
        time to decode the same bytes.
    """
    with TemporaryDirectory() as folder:
        return {
            "overhead_bytes_per_frame": _overhead(Path(folder)),
            "time_ratio_to_plain_decoding": _times(Path(folder)),
        }


def _overhead(folder: Path) -> dict:
    found = {}
    for rate_Hz in _RATES_HZ:
        for what in ("touch", "touch spectrum"):
            link = _Link(rate_Hz, spectra=what != "touch")
            name = f"{what} at {rate_Hz} Hz"
            with Writer(link.now_s, folder / f"{name}.spots", _describe) as recorder:
                header = recorder.bytes
                for _ in range(_READINGS):
                    recorder.take(link.read(0), link.now_s())
            found[name] = round((recorder.bytes - header - link.bytes) / link.frames, 2)
    return found


def _times(folder: Path) -> dict:
    path = folder / "times.spots"
    link = _Link(360, spectra=True)
    pieces = [link.read(0) for _ in range(_READINGS)]
    link.close()
    with Writer(link.now_s, path, _describe) as recorder:
        for _ in pieces:
            recorder.take(link.read(0), link.now_s())
    link.close()
    data = b"".join(pieces)
    jobs: dict[str, Callable[[], int]] = {
        "plain": lambda: _decode(data),
        "record": lambda: _record(link, folder / "again.spots"),
        "read": lambda: sum(1 for _ in Recording(path)),
        "replay": lambda: sum(1 for _ in open_recording(path, math.inf).frames()),
        **{f"export {kind}": lambda kind=kind: _export(path, kind) for kind in EXPORTS},
    }
    seconds: dict[str, list[float]] = {name: [] for name in jobs}
    for _ in range(_ROUNDS):
        for name, job in jobs.items():
            began_s = perf_counter()
            count = job()
            seconds[name].append(perf_counter() - began_s)
            if count != link.frames:
                raise AssertionError(f"{name}: {count} frames of {link.frames}")
    plain_s = median(seconds.pop("plain"))
    return {name: round(median(times) / plain_s, 2) for name, times in seconds.items()}


def _decode(data: bytes) -> int:
    decoder = Decoder()
    return sum(len(decoder.feed(data[i : i + 4096])) for i in range(0, len(data), 4096))


def _record(link: _Link, path: Path) -> int:
    decoder, count = Decoder(), 0
    with Writer(link.now_s, path, _describe) as recorder:
        for _ in range(_READINGS):
            piece = link.read(0)
            recorder.take(piece, link.now_s())
            count += len(decoder.feed(piece))
    link.close()
    path.unlink()
    return count


def _export(path: Path, kind: str) -> int:
    for new in export(path, kind, path.with_name(f"out.{kind}")):
        new.unlink()
    return 2 * _READINGS


if __name__ == "__main__":
    print(json.dumps(measure(), indent=2))
