"""Links that deliver prepared bytes, and recorders of these links."""

from __future__ import annotations

import math

from spots.errors import SpotsError
from spots.link.clockmap import ClockMap
from spots.link.decoder import Decoder
from spots.recording.recording import Recording
from spots.recording.writer import Writer
from spots_device import PROTOCOL

INFO = {
    "re": "hello",
    "protocol": PROTOCOL,
    "board": "b",
    "runtime": "r",
    "firmware": "f",
    "id": "1",
    "channels": [],
}


class ScriptedLink:
    """A link that delivers prepared blocks of bytes, each `step_s` after the previous one."""

    name = "script"

    def __init__(self, pieces, step_s=0.01):
        self._pieces = iter(pieces)
        self._step_s = step_s
        self._now_s = 1000.0
        self.closed = False

    def now_s(self):
        return self._now_s

    def read(self, timeout_s):
        piece = next(self._pieces, None)
        if piece is None:
            raise SpotsError("the board on script was disconnected")
        self._now_s += self._step_s
        return piece

    def write(self, data):
        pass

    def close(self):
        self.closed = True


class Recorded:
    """A link with a recorder of all bytes that are read from it."""

    def __init__(self, link, path, describe, **options):
        self._link = link
        self._recorder = Writer(link.now_s, path, describe, **options)
        self.now_s, self.stop = link.now_s, self._recorder.stop

    def __enter__(self):
        return self

    def __exit__(self, *exception):
        self.stop()

    def read(self, timeout_s):
        data = self._link.read(timeout_s)
        self._recorder.take(data, self.now_s())
        return data


def clock():
    known = ClockMap()
    known.round_trip(999.0, 500_000, 999.01)
    return known


def recorder(path, pieces, step_s=0.01, known=None, **options):
    """Return a `Recorded` link that delivers blocks of bytes.

    Parameters
    ----------
    path : Path
        File of the recording.
    pieces : iterable of bytes
        Blocks, one for each read.
    step_s : float
        Time between two blocks.
    known : ClockMap, optional
        Conversion from board time to host time, whose state is recorded.
    options
        Options of the recorder, such as ``rotate_bytes``.
    """
    known = known or clock()

    def describe():
        return {"info": INFO, "clock": known.state(), "restarts": 0, "calibration": ["a line"]}

    return Recorded(ScriptedLink(pieces, step_s), path, describe, utc_s=lambda: 1.7e9, **options)


def record(path, pieces, step_s=0.01, **options):
    """Record blocks of bytes; return the frames in them, and the statistics of the decoder.

    The parameters are those of `recorder`.
    """
    pieces = list(pieces)
    decoder, known, frames = Decoder(), clock(), []
    with recorder(path, pieces, step_s, known, **options) as tap:
        for _ in pieces:
            frames += [known.timed(frame, tap.now_s()) for frame in decoder.feed(tap.read(1.0))]
    return frames, decoder.stats


def replayed(path):
    recording = Recording(path)
    return [frame for _, frame in recording], recording


def cut(data, sizes):
    """Yield blocks of `data` with these sizes, and a last block with the remaining bytes."""
    at = 0
    for size in sizes:
        yield data[at : at + size]
        at += size
    yield data[at:]


AS_FAST_AS_POSSIBLE = math.inf
