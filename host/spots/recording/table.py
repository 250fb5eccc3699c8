"""Converts frames to rows of tables; defines the columns of all exports."""

import heapq
import json
from collections.abc import Iterator
from itertools import repeat
from typing import Any, NamedTuple

import numpy as np
from rich.console import Console
from rich.progress import BarColumn, Progress, TextColumn, TimeRemainingColumn

from spots_device.reading import decode

from ..errors import printable
from ..link.frames import DOUBTFUL, Text
from .arrays import Arrays, RecordingBlocks


class Table(NamedTuple):
    """A table of exported frames of one kind: its name and its columns.

    Attributes
    ----------
    name : str
        Name of the table, and of the kind of frames.
    dtype : numpy.dtype
        Names and types of the columns; the length of a text is 0. Every table begins with the
        columns ``time_s`` (time of the measurement; if this is unknown, and for a text, the time of
        arrival), ``arrived_s``, ``sensor``, ``sequence`` and ``t_us``. The first two are in s since
        the recording began.
    """

    name: str
    dtype: np.dtype


_FIRST = {"time_s": "f8", "arrived_s": "f8", "sensor": "u1", "sequence": "u2", "t_us": "u4"}
_TOUCH = {
    "touching": "?",
    "trusted": "?",
    "position_um": "i4",
    "force_mN": "u2",
    "contrast_log2": "f8",
    "brightness_log2": "f8",
    "flags": "u1",
}
_SPECTRUM = {"flags": "u1", "gain_code": "u1", "counts": "6u2"}
_CONTACT = {"id": "u1", "state": "u1", "position_um": "i4", "sigma_um": "u2", "force_mN": "u2"}
_KEY = {"page": "u1", "usage": "u2", "modifiers": "u1", "pressed": "?"}
_TEXT = {"content": "U"}
# The first four are in the order of `Arrays.tables`.
_OTHERS = {"touch": _TOUCH, "spectrum": _SPECTRUM, "key": _KEY, "contact": _CONTACT, "text": _TEXT}

TABLES = tuple(
    Table(name, np.dtype(list((_FIRST | others).items()))) for name, others in _OTHERS.items()
)
Row = tuple[Table, tuple[Any, ...]]


def rows(recording: RecordingBlocks) -> Iterator[Row]:
    """Yield pairs (table, row) for all frames in order of arrival; show the progress.

    As in the frames, an unknown position or force is 0; the flags show which values are unknown.
    """
    begun_s = recording.header.host_s
    for block in shown(recording):
        tables = [_array_rows(*pair, begun_s) for pair in zip(TABLES, block.tables)]
        tables.append(_text_rows(block.texts, begun_s))
        yield from heapq.merge(*tables, key=lambda row: row[1][1])


def _array_rows(table: Table, array: np.ndarray, begun_s: float) -> Iterator[Row]:
    arrived_s = [round(one - begun_s, 9) for one in array["arrived_s"].tolist()]
    times_s = zip(array["time_s"].tolist(), arrived_s)
    columns = {name: array[name].tolist() for name in array.dtype.names}
    columns["arrived_s"] = arrived_s
    columns["time_s"] = [late if one != one else round(one - begun_s, 9) for one, late in times_s]
    if "contrast_q20" in columns:
        touching = array["flags"] & decode.TOUCHING != 0
        columns["touching"] = touching.tolist()
        columns["trusted"] = (touching & (array["flags"] & DOUBTFUL == 0)).tolist()
        for name in ("contrast", "brightness"):
            columns[f"{name}_log2"] = (array[f"{name}_q20"] / (1 << 20)).tolist()
    elif "counts" in columns:
        columns["gain_code"] = columns["gain"]
        columns["counts"] = map(tuple, columns["counts"])
    return zip(repeat(table), zip(*(columns[name] for name in table.dtype.names)))


def _text_rows(texts: list[tuple[float, Text]], begun_s: float) -> Iterator[Row]:
    for at_s, text in texts:
        arrived_s = round(at_s - begun_s, 9)
        content = json.dumps(text.content, ensure_ascii=False)
        yield TABLES[-1], (arrived_s, arrived_s, text.sensor, text.sequence, text.t_us, content)


def shown(recording: RecordingBlocks) -> Iterator[Arrays]:
    """Yield the blocks of a recording, and show the progress on a terminal."""
    name = TextColumn(printable(recording.path.name), markup=False)
    columns = name, BarColumn(), TimeRemainingColumn()
    console = Console(stderr=True)
    quiet = not console.is_terminal
    with Progress(*columns, console=console, transient=True, disable=quiet) as progress:
        task = progress.add_task("", total=recording.size)
        for block in recording:
            progress.update(task, completed=recording.read_bytes)
            yield block
