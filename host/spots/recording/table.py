"""Frames as rows of tables: one table a kind, one list of columns for every export."""

from __future__ import annotations

import json
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

import numpy as np
from rich.console import Console
from rich.progress import BarColumn, Progress, TextColumn, TimeRemainingColumn

from spots_device import decode

from ..errors import printable
from ..link.frames import DOUBTFUL, Text
from .arrays import Arrays, RecordingBlocks


@dataclass(frozen=True)
class Table:
    """A kind of frames.

    Attributes
    ----------
    name : str
    columns : dict
        Name to NumPy type; a type with a shape is a tuple, a text is ``"U"``. The first ones are
        the same in every table: ``time_s``, when it was measured (a text: when it arrived), and
        ``arrived_s``, both since the recording began; ``sensor``, ``sequence``, ``t_us``.
    """

    name: str
    columns: dict[str, Any]


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
_SPECTRUM = {"flags": "u1", "gain_code": "u1", "counts": ("u2", (6,))}
_KEY = {"page": "u1", "usage": "u2", "modifiers": "u1", "pressed": "?"}
_TEXT = {"content": "U"}

# In the order of the arrays.
TABLES = [
    Table("touch", _FIRST | _TOUCH),
    Table("spectrum", _FIRST | _SPECTRUM),
    Table("key", _FIRST | _KEY),
    Table("text", _FIRST | _TEXT),
]


def rows(recording: RecordingBlocks) -> Iterator[tuple[Table, tuple[Any, ...]]]:
    """Yield the table and the row of each frame of a recording, showing how far it is.

    Position and force are as on the wire: 0 where the flags say that they are not known.
    """
    begun_s = recording.header.host_s
    for block in shown(recording):
        arrays = block.touches, block.spectra, block.keys
        tables = [_array_rows(array, begun_s) for array in arrays]
        tables.append(_text_rows(block.texts, begun_s))
        for kind in recording.order.tolist():
            yield TABLES[kind], next(tables[kind])


def _array_rows(array: np.ndarray, begun_s: float) -> Iterator[tuple[Any, ...]]:
    columns = {name: array[name].tolist() for name in array.dtype.names or ()}
    arrived_s = [round(one - begun_s, 9) for one in columns.pop("arrived_s")]
    times_s = zip(columns.pop("time_s"), arrived_s)
    time_s = [late if one != one else round(one - begun_s, 9) for one, late in times_s]
    first = [columns.pop(name) for name in ("sensor", "sequence", "t_us")]
    if "contrast_q20" in columns:
        flags = array["flags"]
        touching = flags & decode.TOUCHING != 0
        rest = [touching.tolist(), (touching & (flags & DOUBTFUL == 0)).tolist()]
        rest += [columns["position_um"], columns["force_mN"]]
        rest += [(array[name] / (1 << 20)).tolist() for name in ("contrast_q20", "brightness_q20")]
        rest += [columns["flags"]]
    else:
        rest = [map(tuple, one) if name == "counts" else one for name, one in columns.items()]
    return zip(time_s, arrived_s, *first, *rest)


def _text_rows(texts: list[tuple[float, Text]], begun_s: float) -> Iterator[tuple[Any, ...]]:
    for at_s, text in texts:
        arrived_s = round(at_s - begun_s, 9)
        content = json.dumps(text.content, ensure_ascii=False)
        yield arrived_s, arrived_s, text.sensor, text.sequence, text.t_us, content


def shown(recording: RecordingBlocks) -> Iterator[Arrays]:
    """Yield the blocks of a recording, showing on a terminal how far it is."""
    columns = (
        TextColumn(printable(recording.path.name), markup=False),
        BarColumn(),
        TimeRemainingColumn(),
    )
    console = Console(stderr=True)
    quiet = not console.is_terminal
    with Progress(*columns, console=console, transient=True, disable=quiet) as progress:
        task = progress.add_task("", total=recording.size)
        for block in recording:
            progress.update(task, completed=recording.read_bytes)
            yield block
