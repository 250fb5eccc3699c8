"""Frames as rows of tables: the columns of all exports, and of what `spots publish` sends."""

from __future__ import annotations

import json
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

from rich.console import Console
from rich.progress import BarColumn, Progress, TextColumn, TimeRemainingColumn

from ..errors import printable
from ..link.frames import Key, Reading, Spectrum, Text, Touch
from .recording import Recording


@dataclass(frozen=True)
class Table:
    """The table of a kind of frames.

    Attributes
    ----------
    name : str
        Name of the table, and of the kind of frames.
    columns : dict
        NumPy type of each column, by its name; ``"U"`` for a text, a tuple for a type with a shape.
        The first columns are the same in every table: ``time_s``, time of the measurement (of a
        text: of its arrival), and ``arrived_s``, both since the recording began; ``sensor``,
        ``sequence``, ``t_us``.
    """

    name: str
    columns: dict[str, Any]


_FIRST = {"time_s": "f8", "arrived_s": "f8", "sensor": "u1", "sequence": "u2", "t_us": "u4"}
_VALUES: dict[type, dict[str, Any]] = {
    Touch: {
        "touching": "?",
        "trusted": "?",
        "position_um": "i4",
        "force_mN": "u2",
        "contrast_log2": "f8",
        "brightness_log2": "f8",
        "flags": "u1",
    },
    Spectrum: {"flags": "u1", "gain_code": "u1", "counts": ("u2", (6,))},
    Key: {"page": "u1", "usage": "u2", "modifiers": "u1", "pressed": "?"},
    Text: {"content": "U"},
}
# Columns whose names have a unit that the attribute does not have.
_ATTRIBUTES = {"contrast_log2": "contrast", "brightness_log2": "brightness", "gain_code": "gain"}
TABLES = {kind: Table(kind.__name__.lower(), _FIRST | values) for kind, values in _VALUES.items()}


def values(frame: Reading) -> dict[str, Any]:
    """Return the measured values of a frame, by column name; NaN if unknown."""
    return {name: getattr(frame, _ATTRIBUTES.get(name, name)) for name in _VALUES[type(frame)]}


def rows(recording: Recording) -> Iterator[tuple[Table, tuple[Any, ...]]]:
    """Yield the table and the row of each frame, and show the progress on a terminal.

    As on the wire, an unknown value is 0; the flags show which values are unknown.
    """
    begun_s = recording.header.host_s
    for arrived_s, frame in shown(recording):
        if isinstance(frame, Text):
            time_s, found = None, [json.dumps(frame.content, ensure_ascii=False)]
        else:
            time_s = frame.time_s
            found = [0 if one != one else one for one in values(frame).values()]
        times_s = (round((arrived_s if s is None else s) - begun_s, 9) for s in (time_s, arrived_s))
        yield TABLES[type(frame)], (*times_s, frame.sensor, frame.sequence, frame.t_us, *found)


def shown(recording: Recording) -> Iterator[Any]:
    """Iterate over a recording, and show the progress on a terminal."""
    columns = (
        TextColumn(printable(recording.path.name), markup=False),
        BarColumn(),
        TimeRemainingColumn(),
    )
    console, done = Console(stderr=True), 0
    quiet = not console.is_terminal
    with Progress(*columns, console=console, transient=True, disable=quiet) as progress:
        task = progress.add_task("", total=recording.size)
        for one in recording:
            if recording.read_bytes != done:
                done = recording.read_bytes
                progress.update(task, completed=done)
            yield one
