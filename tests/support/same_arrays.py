"""Checks that the arrays of a recording equal its frames exactly, or that both give one error."""

from __future__ import annotations

import math
import re
from pathlib import Path
from unittest import mock

import pytest

from spots.errors import SpotsError
from spots.link.frames import Contact, Key, Spectrum, Text, Touch
from spots.recording import arrays
from spots.recording.header import Clock, Header, encoded
from spots.recording.recording import Recording
from spots_device.reading import decode
from support.reels import INFO, clock

_TABLES = {Touch: "touches", Spectrum: "spectra", Key: "keys", Contact: "contacts"}
_COUNTS = ("stats", "notes", "restarts", "cut_bytes", "read_bytes", "end_s", "complete", "joined")


def recording_of(path: Path, data: bytes, part: int = 0, restarts: int = 0) -> Path:
    """Write a recording that consists of a header and the bytes `data`; return its path.

    Parameters
    ----------
    path : Path
        File to write.
    data : bytes
        Frames and notes.
    part, restarts : int
        Number of the part in a set of files, and restarts of the board before it.
    """
    header = Header(
        recording=1,
        program="test",
        set="a",
        part=part,
        host_s=1000.0,
        utc_s=1.7e9,
        info=INFO,
        clock=Clock(**clock().state()),
        restarts=restarts,
    )
    path.write_bytes(encoded(header) + data)
    return path


def check(path: Path, block_bytes: int = arrays._BLOCK_BYTES) -> int:
    """Check that arrays and single frames of a recording are equal; return the number of frames.

    If one of the two ways to read the recording fails, the other must fail with the same message;
    the result is then 0.

    Parameters
    ----------
    path : Path
        The recording.
    block_bytes : int
        Number of bytes that are decoded into arrays in one call.
    """
    with mock.patch.object(arrays, "_BLOCK_BYTES", block_bytes):
        recording, frames, refusal = _frames(path)
        if refusal is not None:
            with pytest.raises(SpotsError, match=f"^{re.escape(refusal)}$"):
                arrays.read_arrays(path)
            return 0
        got = arrays.read_arrays(path)
        blocks = arrays.RecordingBlocks(path)
        parts = list(blocks)
    for name in _COUNTS:
        assert getattr(blocks, name) == getattr(recording, name), name
    assert got.stats == recording.stats
    assert repr(got.texts) == repr(frames[Text])  # NaN is not NaN
    assert sum(len(part.texts) for part in parts) == len(got.texts)
    for kind, name in _TABLES.items():
        table = getattr(got, name)
        added = ("arrived_s", "known") if kind in _KNOWN else ("arrived_s",)
        assert sorted(table.dtype.names) == sorted((*kind._fields, *added))
        assert _bits(_rows(table, kind)) == _bits(frames[kind])
        if kind in _KNOWN:
            wanted = [not {"nan"} & set(map(str, frame[:8])) for _, frame in frames[kind]]
            assert table["known"].tolist() == wanted
        assert sum(len(getattr(part, name)) for part in parts) == len(table)
        assert all(table.dtype == getattr(part, name).dtype for part in parts)
    return sum(map(len, frames.values()))


def _frames(path):
    frames = {kind: [] for kind in (*_TABLES, Text)}
    recording = None
    try:
        recording = Recording(path)
        for arrived_s, frame in recording:
            frames[type(frame)].append((arrived_s, frame))
    except SpotsError as error:
        return recording, frames, str(error)
    return recording, frames, None


def _rows(table, kind):
    columns = {name: table[name].tolist() for name in table.dtype.names}
    if kind is Spectrum:
        for name in ("counts", "taken_off_q6"):
            columns[name] = list(map(tuple, columns[name]))
    if "time_s" in columns:
        columns["time_s"] = [None if time != time else time for time in columns["time_s"]]
    rows = map(kind, *(columns[name] for name in kind._fields))
    return list(zip(columns["arrived_s"], map(_KNOWN.get(kind, _as_is), rows)))


def _known(touch):
    """Return a `Touch` as an array has it: NaN for an unknown position or force."""
    blind = touch.flags & (decode.NOT_CALIBRATED | decode.LED_OFF)
    if blind or not (touch.flags & decode.TOUCHING or touch.force_mN):
        touch = touch._replace(position_um=math.nan)
    return touch._replace(force_mN=math.nan) if blind else touch


def _known_force(contact):
    return contact._replace(force_mN=contact.force_mN or math.nan)


def _as_is(row):
    return row


_KNOWN = {Touch: _known, Contact: _known_force}


def _bits(rows):
    return [repr(row) for row in rows]  # the repr of a float is exact, and True differs from 1
