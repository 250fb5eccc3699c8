"""Recordings as NumPy arrays, decoded a block at a time."""

from __future__ import annotations

import re
import struct
from collections.abc import Iterator
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from spots_device import frame
from spots_device.kernel import CRC_SIZE

from ..link.frames import ENCODED_MAX, NOTE, PARSERS, Decoder, LinkStats, Note, Text, checked
from .columns import SIZE_MAX, payloads
from .header import Header
from .recording import Recording

# Of working memory a block takes about twenty times as much.
_BLOCK_BYTES = 1 << 18
# Of so few pieces each is decoded alone in less time than all of them together.
_FEW = 64
_COBS_SIZE = 1
_SIZE_MIN = frame.HEADER_SIZE + CRC_SIZE + _COBS_SIZE
_DAMAGED = 16  # no kind
_NOTHING = np.empty(0, np.intp), np.empty((SIZE_MAX, 0), np.uint8)

_HEADER = [
    ("time_s", "<f8"),
    ("arrived_s", "<f8"),
    ("t_us", "<u4"),
    ("sequence", "<u2"),
    ("sensor", "u1"),
]
# Name, place and bytes on the wire. Kind and sensor share byte 0; the time's halves are one u4.
_WIRE_HEADER = [("sequence", 1, 2), ("t_us", 3, 4)]


class _Table:
    """How frames of a kind lie on the wire and in an array.

    Parameters
    ----------
    body : str
        The layout of `spots_device.frame`.
    columns : list
        Names and types of the body's values, in the order of the wire.
    """

    def __init__(self, body: str, columns: list[tuple[Any, ...]]):
        self.size = _SIZE_MIN + struct.calcsize("<" + body)
        header: list[Any] = [*_HEADER, *columns]
        self.dtype = np.dtype(header, align=True)
        self._fields: Any = self.dtype.fields
        self._wire = list(_WIRE_HEADER)
        at = frame.HEADER_SIZE
        for (name, *_), part in zip(columns, re.findall(r"\d*\D", body)):
            size = struct.calcsize("<" + part)
            self._wire.append((name, at, size))
            at += size

    def array(self, columns: np.ndarray, time_s: np.ndarray, arrived_s: np.ndarray) -> np.ndarray:
        """Return payloads, each a column of bytes, as rows."""
        rows = np.zeros((columns.shape[1], self.dtype.itemsize), np.uint8)
        for name, at, size in self._wire:
            offset = self._fields[name][1]
            rows[:, offset : offset + size] = columns[at : at + size].T
        array = rows.view(self.dtype)[:, 0]
        array["sensor"] = columns[0] >> 4
        array["time_s"], array["arrived_s"] = time_s, arrived_s
        if "pressed" in self._fields:
            pressed = self._fields["pressed"][1]
            rows[:, pressed] = rows[:, pressed] != 0  # on the wire, true is whatever is not 0
        return array


_TABLES = {
    frame.TOUCH: _Table(
        frame.TOUCH_BODY,
        [
            ("flags", "u1"),
            ("contrast_q20", "<i4"),
            ("brightness_q20", "<i4"),
            ("position_um", "<i4"),
            ("force_mN", "<u2"),
        ],
    ),
    frame.SPECTRUM: _Table(
        frame.SPECTRUM_BODY, [("flags", "u1"), ("gain", "u1"), ("counts", "<u2", (6,))]
    ),
    frame.KEY: _Table(
        frame.KEY_BODY, [("page", "u1"), ("usage", "<u2"), ("modifiers", "u1"), ("pressed", "?")]
    ),
}


class _Found(NamedTuple):
    """What a block has, by the places of its pieces in it.

    Attributes
    ----------
    t_us : ndarray of int64
        Board time of each piece.
    tables : dict
        Kind to places and payloads, each a column of bytes.
    notes_at, since_us : ndarray of int64
        Where notes are, and their times.
    odd : list of (int, Text or Note)
        What has a content.
    """

    t_us: np.ndarray
    tables: dict[int, tuple[np.ndarray, np.ndarray]]
    notes_at: np.ndarray
    since_us: np.ndarray
    odd: list[tuple[int, Text | Note]]


class _BlockDecoder(Decoder):
    """Finds in a stream what `Decoder` finds, and counts the same."""

    def feed_block(self, data: bytes) -> _Found:
        """Take bytes and return what they complete."""
        stream = self._completed(data)
        ends = np.flatnonzero(stream == 0)
        starts = np.concatenate(([0], ends[:-1] + 1))[: len(ends)]
        sizes = ends - starts
        starts, sizes = starts[sizes > 0], sizes[sizes > 0]
        headers = np.zeros((frame.HEADER_SIZE, len(sizes)), np.uint8)
        good = np.zeros(len(sizes), bool)
        groups: dict[int, tuple[np.ndarray, np.ndarray]] = {}
        counts = np.bincount(np.minimum(sizes, ENCODED_MAX + 1))
        for size in range(_SIZE_MIN, min(len(counts), ENCODED_MAX + 1)):
            if not counts[size]:
                continue
            where = np.flatnonzero(sizes == size)
            decode = _one_by_one if size > SIZE_MAX or counts[size] < _FEW else payloads
            columns, right = decode(stream, starts[where], size)
            where = where[right]
            good[where] = True
            headers[:, where] = columns[: frame.HEADER_SIZE]
            groups[size] = where, columns
        kinds = np.where(good, headers[0] & 0x0F, _DAMAGED)
        sequence, low, high = headers[1:].T.copy().view("<u2").T.astype(np.int64)
        t_us = low | high << 16
        self.stats.bad_crc += len(good) - int(good.sum())
        tables: dict[int, tuple[np.ndarray, np.ndarray]] = {}
        for kind, table in _TABLES.items():
            where, columns = groups.get(table.size, _NOTHING)
            of_kind = kinds[where] == kind
            tables[kind] = where[of_kind], columns if of_kind.all() else columns[:, of_kind]
            self.stats.bad_crc += int(np.sum(kinds == kind)) - int(np.sum(of_kind))
        bare = (kinds == NOTE) & (sizes == _SIZE_MIN)
        odd: list[tuple[int, Text | Note]] = []
        for at in np.flatnonzero((kinds == frame.TEXT) | (kinds == NOTE) & ~bare).tolist():
            body = checked(stream[starts[at] : starts[at] + sizes[at]].tobytes()) or b""
            header = int(headers[0, at]) >> 4, int(sequence[at]), int(t_us[at])
            try:
                one: Any = PARSERS[kinds[at]](*header, body[frame.HEADER_SIZE :])
            except ValueError:
                self.stats.bad_crc += 1
            else:
                odd.append((at, one))
        notes = [at for at, one in odd if isinstance(one, Note)]
        notes_at = np.sort(np.concatenate((np.flatnonzero(bare), notes)).astype(np.int64))
        self._count_all(kinds, sequence, odd)
        return _Found(t_us, tables, notes_at, (sequence << 32 | t_us)[notes_at], odd)

    def _completed(self, data: bytes) -> np.ndarray:
        """Return the bytes from one delimiter to another; what follows is kept for the next."""
        self.stats.bytes += len(data)
        data = self._rest + data
        end = data.rfind(b"\0") + 1
        begin = 0
        if self._overlong and end:
            begin = data.index(b"\0") + 1
            self._overlong = False
        self._rest = data[end:]
        if self._overlong or len(self._rest) > ENCODED_MAX:
            self.stats.bad_crc += not self._overlong
            self._overlong, self._rest = True, b""
        return np.frombuffer(data, np.uint8)[begin:end]

    def _count_all(
        self, kinds: np.ndarray, sequence: np.ndarray, odd: list[tuple[int, Text | Note]]
    ) -> None:
        counted = np.flatnonzero((kinds != NOTE) & (kinds != _DAMAGED))
        if len(counted):
            sequence = sequence[counted]
            expected = sequence[0] if self._expected is None else self._expected
            gaps = np.diff(sequence, prepend=expected - 1) - 1 & 0xFFFF
            gaps[gaps >= 1 << 15] = 0  # an old frame came again, or the board restarted
            lost = np.zeros(len(kinds), np.int64)
            lost[counted] = gaps
            self._expected = int(sequence[-1]) + 1 & 0xFFFF
            self.stats.frames += len(counted)
        else:
            lost = np.zeros(len(kinds), np.int64)
        reading = (kinds == frame.TOUCH) | (kinds == frame.SPECTRUM)
        begin = 0
        for at, one in [*odd, (len(kinds), None)]:
            if isinstance(one, Text):
                continue
            readings = np.flatnonzero(reading[begin:at])
            if len(readings):
                until = begin + readings[-1] + 1
                self._lost_at_reading = self.stats.lost + int(lost[begin:until].sum())
            self.stats.lost += int(lost[begin:at].sum())
            begin = at
            if one is not None:
                self._noted(one.content)


def _one_by_one(data: np.ndarray, starts: np.ndarray, size: int) -> tuple[np.ndarray, np.ndarray]:
    """Return what `payloads` does; of pieces of any size, at least the headers."""
    found = [checked(data[start : start + size].tobytes()) for start in starts.tolist()]
    good = np.array([payload is not None for payload in found])
    # Of long pieces of one size, payloads may differ in size: nobody needs more than the headers.
    length = size - _COBS_SIZE - CRC_SIZE if size <= SIZE_MAX else frame.HEADER_SIZE
    joined = b"".join(payload[:length] for payload in found if payload is not None)
    return np.frombuffer(joined, np.uint8).reshape(-1, length).T, good


@dataclass(frozen=True, eq=False)
class Arrays:
    """Frames of a recording, or of a block of it, as structured arrays.

    Integers are those of the wire: position and force are 0 where `Touch` has NaN. See ``flags``,
    bits of `spots_device.decode`. Rows are in the order in which the frames arrived. All three
    begin with the same columns:

    ========== === =============================================================
    time_s     f8  when it was measured, on the host's monotonic clock; NaN where
                   nobody compared the clocks
    arrived_s  f8  when it arrived, on the same clock, as `Recording` has it
    t_us       u4  board time, modulo 2**32
    sequence   u2  number of the frame on its link, modulo 2**16
    sensor     u1  which sensor of the board
    ========== === =============================================================

    Attributes
    ----------
    touches : ndarray
        Then ``flags`` u1, ``contrast_q20`` i4, ``brightness_q20`` i4 (log2 units times 2**20),
        ``position_um`` i4, ``force_mN`` u2, as in `Touch`. 40 bytes a row.
    spectra : ndarray
        Then ``flags`` u1, ``gain`` u1, ``counts`` six u2, as in `Spectrum`. 40 bytes a row.
    keys : ndarray
        Then ``page`` u1, ``usage`` u2, ``modifiers`` u1, ``pressed`` bool, as in `Key`. 32 bytes
        a row.
    texts : list of (float, Text)
        Replies and log lines, with ``arrived_s``.
    stats : LinkStats
        What the recorded link lost, from the beginning of the recording to the end of the block.

    Examples
    --------
    >>> from spots import read_arrays
    >>> int(read_arrays("run.spots").touches["force_mN"].max())
    7075
    """

    touches: np.ndarray
    spectra: np.ndarray
    keys: np.ndarray
    texts: list[tuple[float, Text]]
    stats: LinkStats


class RecordingBlocks(Recording):
    """A recording; iterate over it to read it as `Arrays`, a block at a time.

    Memory is bounded: a block is of 256 KiB of the file. What is not in the arrays
    is in the attributes of `Recording`.

    Attributes
    ----------
    order : ndarray of int
        Of the frames of the latest block, in the order of the file: which of the four fields of
        `Arrays` has the next one.

    Examples
    --------
    >>> from spots import RecordingBlocks
    >>> blocks = RecordingBlocks("run.spots")
    >>> max(int(block.touches["force_mN"].max(initial=0)) for block in blocks)
    7075
    """

    def __iter__(self) -> Iterator[Arrays]:  # pyright: ignore[reportIncompatibleMethodOverride]
        for path, header, block in self._blocks(_BLOCK_BYTES):
            yield self._arrays(path, header, self._decoder.feed_block(block))

    def _arrays(self, path: Path, header: Header, found: _Found) -> Arrays:
        count = len(found.t_us)
        arrivals_s = np.concatenate(([self.end_s], header.host_s + 1e-6 * found.since_us))
        arrived_s = np.repeat(arrivals_s, np.diff(found.notes_at, prepend=0, append=count))
        timed = np.zeros(count, bool)
        for where, _ in found.tables.values():
            timed[where] = True
        time_s, mapped = np.empty(count), 0
        texts: list[tuple[float, Text]] = []
        for at, one in [*found.odd, (count, None)]:
            if isinstance(one, Text):
                texts.append((float(arrived_s[at]), one))
                continue
            if one is None or "clock" in one.content:
                which = mapped + np.flatnonzero(timed[mapped:at])
                time_s[which] = self._clock.host_s_each(found.t_us[which], arrived_s[which])
                mapped = at
            if one is not None:
                self._note(path, header, one)
        self.notes += len(found.notes_at) - sum(isinstance(one, Note) for _, one in found.odd)
        self.end_s = float(arrivals_s[-1])
        kinds = np.full(count, -1)
        for i, (where, _) in enumerate(found.tables.values()):
            kinds[where] = i
        kinds[[at for at, one in found.odd if isinstance(one, Text)]] = len(found.tables)
        self.order = kinds[kinds >= 0]
        touches, spectra, keys = (
            _TABLES[kind].array(columns, time_s[where], arrived_s[where])
            for kind, (where, columns) in found.tables.items()
        )
        return Arrays(touches, spectra, keys, texts, replace(self.stats))

    def _restart(self) -> None:
        super()._restart()
        self._decoder = _BlockDecoder()


class _Growing:
    """An array that grows in place, without a second copy in memory."""

    def __init__(self, dtype: np.dtype):
        self._array = np.empty(0, dtype)
        self._size = 0

    def extend(self, rows: np.ndarray) -> None:
        end = self._size + len(rows)
        if end > len(self._array):
            self._array.resize(end + end // 8, refcheck=False)
        self._array[self._size : end] = rows
        self._size = end

    def whole(self) -> np.ndarray:
        self._array.resize(self._size, refcheck=False)
        return self._array


def read_arrays(path: str | Path) -> Arrays:
    """Read a recording, or a set of them, as structured arrays.

    They have what iterating over a `Recording` gives, to the last bit, but 0 for a position or a
    force that is not known; a damaged recording, too.
    A day at 100 Hz is 8.6 million readings, and 350 MB as ``touches``: where that is too much, see
    `RecordingBlocks`.

    Parameters
    ----------
    path : str or Path
        With the first file of a set come the others. A later one stands for itself.

    Returns
    -------
    Arrays
        ``touches``, ``spectra`` and ``keys`` with the columns that it describes, ``texts`` and
        ``stats``.

    Raises
    ------
    SpotsError
        If it is no recording, cannot be read, or a file of the set is missing.

    Examples
    --------
    >>> import numpy as np
    >>> import spots
    >>> from spots_device.decode import TOUCHING
    >>> touches = spots.read_arrays("run.spots").touches
    >>> touching = touches["flags"] & TOUCHING != 0
    >>> position_mm = np.where(touching, touches["position_um"] / 1000, np.nan)
    >>> int(touching.sum()), len(position_mm)
    (92, 301)
    """
    blocks = RecordingBlocks(path)
    growing = [_Growing(table.dtype) for table in _TABLES.values()]
    texts: list[tuple[float, Text]] = []
    for block in blocks:
        for array, rows in zip(growing, (block.touches, block.spectra, block.keys)):
            array.extend(rows)
        texts += block.texts
    touches, spectra, keys = (array.whole() for array in growing)
    return Arrays(touches, spectra, keys, texts, replace(blocks.stats))
