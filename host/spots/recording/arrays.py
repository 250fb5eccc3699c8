"""Reads recordings as NumPy arrays, a block at a time."""

import re
import warnings
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from spots_device.reading import frame
from spots_device.reading.decode import CRC_SIZE, HEADER_SIZE

from ..common.certainty import Certainty
from ..link.decoder import LAYOUTS, NOTE, SPECTRUM_REST, Decoder
from ..link.frames import (
    Contact,
    Frame,
    LinkStats,
    Note,
    Reading,
    Text,
    Touch,
    log2_unknown,
    position_known,
)
from .columns import payloads
from .header import Header
from .recording import Mark, Recording

# Decoding a block needs about twenty times this size as working memory.
_BLOCK_BYTES = 1 << 18
_COBS_SIZE = 1  # bytes that COBS adds to a short frame

_TIMES = [("time_s", "<f8"), ("arrived_s", "<f8")]
_HEADER = [*_TIMES, ("t_us", "<u4"), ("sequence", "<u2"), ("sensor", "u1")]
# By kind of frame that may have unknown values: a function that finds the rows without any.
_KNOWN: dict[type[Reading], Callable[[np.ndarray], Any]] = {
    Touch: lambda rows: position_known(rows["flags"], rows["force_mN"]),
    Contact: lambda rows: rows["force_mN"] != 0,
}


class _Table:
    """One kind of frame: its layout as bytes on the link, and as a row of an array.

    `body` is the `struct` format of the bytes after the header, in the order of the fields of
    `kind`.
    """

    def __init__(self, kind: type[Reading], body: str):
        header = [("kind", "u1"), ("sequence", "<u2"), ("t_us", "<u4")]
        names = [name for name in kind._fields if name not in dict(_HEADER)]
        columns = list(zip(names, ["<" + code for code in re.findall(r"\d*\w", body)]))
        self._wire = np.dtype(header + columns)
        self.size = self._wire.itemsize + CRC_SIZE + _COBS_SIZE
        # On the link, any byte except 0 means true.
        columns = [(name, "?" if name == "pressed" else code) for name, code in columns]
        self._known = _KNOWN.get(kind)
        known = [("known", "?")] if self._known else []
        sigma = [("sigma_um", "<f8")] if kind is Touch else []
        self.dtype = np.dtype([*_HEADER, *columns, *known, *sigma], align=True)

    def array(self, columns: np.ndarray, time_s: np.ndarray, arrived_s: np.ndarray) -> np.ndarray:
        """Convert payloads, one a column of n, to n rows of `dtype`; the times are host times."""
        wire: Any = np.ascontiguousarray(columns.T).view(self._wire)[:, 0]
        rows = np.zeros(len(wire), self.dtype)
        for name in wire.dtype.names[1:]:
            rows[name] = wire[name]
        rows["sensor"] = wire["kind"] >> 4
        rows["time_s"], rows["arrived_s"] = time_s, arrived_s
        if self._known:
            rows["known"] = self._known(rows)
        return rows


_TABLES = {kind: _Table(*layout) for kind, layout in LAYOUTS.items()}
# Kind, bytes when encoded, and what completes the body, of each frame that is decoded in groups. A
# note without content has the smallest size.
_SIZES = [(kind, table.size, b"") for kind, table in _TABLES.items()]
_SIZES.append((NOTE, HEADER_SIZE + CRC_SIZE + _COBS_SIZE, b""))
_SHORT = _TABLES[frame.SPECTRUM].size - len(SPECTRUM_REST)
_SIZES.append((frame.SPECTRUM, _SHORT, SPECTRUM_REST))


# By kind of frame: indices of its pieces, and their payloads, shape (bytes, number of pieces).
_Groups = dict[int, tuple[np.ndarray, np.ndarray]]


class _Run(NamedTuple):
    """Consecutive pieces of a recording: notes that contain only a time, and frames except texts.

    A note is metadata that the recorder adds between frames. A piece is the bytes between two
    delimiters. Indices count these pieces from 0. `t_us` is the time of each piece: board time
    modulo 2**32, or the low 32 bits of a note's time. `since_us` is the time of each note since the
    recording's file began. `tables` has, for each kind of frame, the indices of its frames, and an
    array whose columns are the payloads.
    """

    t_us: np.ndarray
    notes_at: np.ndarray
    since_us: np.ndarray
    tables: _Groups


def _merged(
    where: np.ndarray, columns: np.ndarray, other: tuple[np.ndarray, np.ndarray] | None
) -> tuple[np.ndarray, np.ndarray]:
    # Pieces of one kind and two sizes, in order.
    if other is None:
        return where, columns
    where, columns = np.concatenate([where, other[0]]), np.hstack([columns, other[1]])
    order = where.argsort()
    return where[order], columns[:, order]


class _BlockDecoder(Decoder):
    """Decodes a block of bytes in one call, with the same frames and statistics as `Decoder`."""

    def feed_block(self, data: bytes) -> Iterator[_Run | Frame]:
        """Yield the frames of a block of bytes in order: single frames, or many as one `_Run`."""
        stream = np.frombuffer(self._completed(data), np.uint8)
        ends = np.flatnonzero(stream == 0)
        starts = np.concatenate(([0], ends[:-1] + 1))[: len(ends)]
        starts, ends = starts[ends > starts], ends[ends > starts]
        headers = np.zeros((HEADER_SIZE, len(starts)), np.uint8)
        plain = np.zeros(len(starts), bool)
        groups: _Groups = {}
        for kind, size, rest in _SIZES:
            where = np.flatnonzero(ends - starts == size)
            if not len(where):
                continue
            columns, good = payloads(stream, starts[where], size)
            where = where[good]
            right = columns[0] & 0x0F == kind
            where, columns = where[right], columns if right.all() else columns[:, right]
            if rest:
                same = np.frombuffer(rest, np.uint8)[:, np.newaxis].repeat(len(where), axis=1)
                columns = np.concatenate([columns, same])
            groups[kind] = _merged(where, columns, groups.get(kind))
            headers[:, where] = columns[:HEADER_SIZE]
            plain[where] = True
        begin = 0
        for at in [*np.flatnonzero(~plain).tolist(), len(plain)]:
            if at > begin:
                yield self._run(headers[:, begin:at], begin, groups)
            begin = at + 1
            if at < len(plain):
                found = self._take(stream[starts[at] : ends[at]].tobytes())
                if found is not None:
                    yield found

    def _run(self, headers: np.ndarray, begin: int, groups: _Groups) -> _Run:
        kinds = headers[0] & 0x0F
        sequence, low, high = headers[1:].T.copy().view("<u2").T.astype(np.int64)
        t_us = low | high << 16
        counted = np.flatnonzero(kinds != NOTE)
        if len(counted):
            numbers = sequence[counted]
            expected = numbers[0] if self._expected is None else self._expected
            gaps = np.diff(numbers, prepend=expected - 1) - 1 & 0xFFFF
            begun = 0
            for gap in [*np.flatnonzero(gaps).tolist(), len(counted)]:
                between = counted[begun:gap]
                self._count_all(kinds[between], numbers[begun:gap], t_us[between])
                if gap < len(counted):
                    at = int(counted[gap])
                    self._count(int(kinds[at]), int(numbers[gap]), int(t_us[at]))
                begun = gap + 1
        tables: _Groups = {}
        for kind, (where, columns) in groups.items():
            first, end = np.searchsorted(where, (begin, begin + len(kinds)))
            if kind != NOTE and end > first:
                tables[kind] = where[first:end] - begin, columns[:, first:end]
        notes_at = np.flatnonzero(kinds == NOTE)
        return _Run(t_us, notes_at, (sequence << 32 | t_us)[notes_at], tables)

    def _count_all(self, kinds: np.ndarray, numbers: np.ndarray, t_us: np.ndarray) -> None:
        """Count readings and keys without a gap, as `_count` does."""
        if not len(kinds):
            return
        begun = self.stats.frames + self.stats.lost + 1
        self._expected = int(numbers[-1]) + 1 & 0xFFFF
        self.stats.frames += len(kinds)
        readings = np.flatnonzero(kinds != frame.KEY)
        if len(readings):
            self._lost_at_reading = self.stats.lost
            readings = readings[-(self._recent.maxlen or 0) :]
            self._recent.extend(zip(t_us[readings].tolist(), (begun + readings).tolist()))


@dataclass(frozen=True, eq=False)
class Arrays:
    """Frames of a recording, or of a block of a recording, as structured arrays.

    Values are the integers of the frames: an unknown position or force is 0, not NaN as in `Touch`.
    So select the rows whose column ``known`` is true before you average positions. Rows are in the
    order of arrival. The first columns of the four arrays are the same:

    - ``time_s`` f8: time of the measurement on the host's monotonic clock, in s; NaN if the clocks
      of board and host were never compared
    - ``arrived_s`` f8: time of arrival on the same clock, in s, as in `Recording`
    - ``t_us`` u4: board time in us, modulo ``2**32``
    - ``sequence`` u2: number of the frame, modulo ``2**16``, as in `Touch`
    - ``sensor`` u1: number of the sensor on the board

    Attributes
    ----------
    touches : ndarray, shape (n,)
        More columns: ``flags`` u1, ``contrast_q20`` i4, ``brightness_q20`` i4 (log2 units times
        2**20), ``position_um`` i4, ``force_mN`` u2, as in `Touch`; ``known`` bool: whether position
        and force are known; ``sigma_um`` f8, as in `Touch`. 48 bytes a row.
    spectra : ndarray, shape (n,)
        More columns: ``flags`` u1, ``gain`` u1, ``counts`` six u2, ``taken_off_q6`` six u4,
        ``temperature_mC`` i4, ``context`` u1, as in `Spectrum`. 72 bytes a row.
    keys : ndarray, shape (n,)
        More columns: ``page`` u1, ``usage`` u2, ``modifiers`` u1, ``pressed`` bool, as in `Key`. 32
        bytes a row.
    contacts : ndarray, shape (n,)
        More columns: ``id`` u1, ``state`` u1, ``position_um`` i4, ``sigma_um`` u2, ``force_mN`` u2,
        as in `Contact`; ``known`` bool: whether the force is known. 40 bytes a row.
    texts : list of (float, Text)
        Time of arrival and frame of each reply and log line.
    marks : list of Mark
        Moments that a program marked, see `Board.mark`.
    stats : LinkStats
        Statistics of the recorded link from the beginning of the recording to the end of the block.

    Examples
    --------
    >>> from spots import read_arrays
    >>> int(read_arrays("run.spots").touches["force_mN"].max())
    3527
    """

    touches: np.ndarray
    spectra: np.ndarray
    keys: np.ndarray
    contacts: np.ndarray
    texts: list[tuple[float, Text]]
    stats: LinkStats
    marks: list[Mark] = field(default_factory=list[Mark])

    @property
    def tables(self) -> tuple[np.ndarray, ...]:
        """The arrays of touches, spectra, keys and contacts, in this order."""
        return self.touches, self.spectra, self.keys, self.contacts


class RecordingBlocks(Recording):
    """Reads a recording in blocks of 256 KiB; iteration yields an `Arrays` object for each block.

    Memory use does not grow with the length of the recording. This object also has the attributes
    of `Recording`.

    Parameters
    ----------
    path : str or Path
        File of the recording. If this is the first of several files of one recording, the other
        files are read too.

    Examples
    --------
    >>> from spots import RecordingBlocks
    >>> blocks = RecordingBlocks("run.spots")
    >>> max(int(block.touches["force_mN"].max(initial=0)) for block in blocks)
    3527
    """

    def __iter__(self) -> Iterator[Arrays]:  # pyright: ignore[reportIncompatibleMethodOverride]
        for path, header, block in self._blocks(_BLOCK_BYTES):
            parts: dict[int, list[np.ndarray]] = {kind: [] for kind in _TABLES}
            texts: list[tuple[float, Text]] = []
            marks = len(self.marks)
            for found in self._decoder.feed_block(block):
                if isinstance(found, _Run):
                    self._add(found, header, parts)
                elif isinstance(found, Note):
                    self._note(path, header, found)
                elif isinstance(found, Text):
                    texts.append((self.end_s, found))
            tables = (_joined(rows, _TABLES[kind].dtype) for kind, rows in parts.items())
            stats, found_marks = replace(self.stats), self.marks[marks:]
            yield Arrays(*tables, texts=texts, stats=stats, marks=found_marks)

    def _add(self, run: _Run, header: Header, parts: dict[int, list[np.ndarray]]) -> None:
        count = len(run.t_us)
        arrivals_s = np.concatenate(([self.end_s], header.host_s + 1e-6 * run.since_us))
        arrived_s = np.repeat(arrivals_s, np.diff(run.notes_at, prepend=0, append=count))
        frames = np.delete(np.arange(count), run.notes_at)
        time_s = np.empty(count)
        time_s[frames] = self._clock.host_s_each(run.t_us[frames], arrived_s[frames])
        for kind, (where, columns) in run.tables.items():
            rows = _TABLES[kind].array(columns, time_s[where], arrived_s[where])
            if kind == frame.TOUCH:
                _add_sigmas(rows, self._certainties)
            parts[kind].append(rows)
        self.notes += len(run.notes_at)
        self.end_s = float(arrivals_s[-1])

    def _restart(self) -> None:
        super()._restart()
        self._decoder = _BlockDecoder()


def _add_sigmas(rows: np.ndarray, certainties: dict[int, Certainty]) -> None:
    rows["sigma_um"] = np.nan
    known = rows["known"] & ~log2_unknown(rows["brightness_q20"], rows["flags"])
    for sensor, certainty in certainties.items():
        own = np.flatnonzero(known & (rows["sensor"] == sensor))
        brightness = rows["brightness_q20"][own] / (1 << 20)
        sigma_um = certainty.sigma_um(rows["position_um"][own], brightness)
        rows["sigma_um"][own] = sigma_um.round(1)


def _joined(parts: list[np.ndarray], dtype: np.dtype) -> np.ndarray:
    # Usually a block has one part. A copy of it would take a tenth of the decoding time.
    if len(parts) == 1:
        return parts[0]
    return np.concatenate(parts) if parts else np.empty(0, dtype)


def read_arrays(path: str | Path) -> Arrays:
    """Read a recording as structured arrays.

    The values are the same as from `Recording`, to the last bit, but an unknown position or force
    is 0 and not NaN; then the column ``known`` is false. A day at 100 Hz has 8.6 million readings,
    which are 415 MB of ``touches``. `RecordingBlocks` needs less memory.

    Parameters
    ----------
    path : str or Path
        File of the recording. If this is the first of several files of one recording, the other
        files are read too.

    Returns
    -------
    Arrays
        All frames of the recording.

    Warns
    -----
    UserWarning
        If the recording is cut off, damaged or joined, or frames are missing; see
        `Recording.doubts`.

    Raises
    ------
    SpotsError
        If the file is not a recording or cannot be read, or a later file is missing although a file
        after it exists.

    Examples
    --------
    >>> import spots
    >>> touches = spots.read_arrays("run.spots").touches
    >>> pressed = touches[touches["known"]]
    >>> len(pressed), len(touches), bool((pressed["position_um"] > 0).all())
    (238, 300, True)
    """
    blocks = RecordingBlocks(path)
    growing = [bytearray() for _ in _TABLES]  # they grow in place, without a second copy in memory
    texts: list[tuple[float, Text]] = []
    for block in blocks:
        for array, rows in zip(growing, block.tables):
            array.extend(rows.tobytes())
        texts += block.texts
    if blocks.doubts:
        warnings.warn(
            f"{path} is read to its end, but {', and '.join(blocks.doubts)}", stacklevel=2
        )
    dtypes = (table.dtype for table in _TABLES.values())
    arrays = map(np.frombuffer, growing, dtypes)
    return Arrays(*arrays, texts=texts, stats=replace(blocks.stats), marks=blocks.marks)
