"""Frames as rows of tables: one table a kind, one list of columns for every export."""

from __future__ import annotations

import json
from collections.abc import Callable, Iterator
from dataclasses import dataclass

from rich.console import Console
from rich.progress import BarColumn, Progress, TextColumn, TimeRemainingColumn

from ..errors import printable
from ..link.frames import Frame, Key, Spectrum, Text, Touch
from .recording import Recording

_PROGRESS_EVERY = 4096


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
    rest : callable
        Returns what a frame has for the columns after these.
    """

    name: str
    columns: dict
    rest: Callable[[Frame], tuple]


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


def _touch(frame: Touch) -> tuple:
    where_and_force = frame.position_um, frame.force_mN
    logs = frame.contrast, frame.brightness
    return (frame.touching, frame.trusted, *where_and_force, *logs, frame.flags)


def _key(frame: Key) -> tuple:
    return frame.page, frame.usage, frame.modifiers, frame.pressed


TABLES = {
    Touch: Table("touch", _FIRST | _TOUCH, _touch),
    Spectrum: Table("spectrum", _FIRST | _SPECTRUM, lambda f: (f.flags, f.gain, f.counts)),
    Key: Table("key", _FIRST | _KEY, _key),
    Text: Table("text", _FIRST | _TEXT, lambda f: (json.dumps(f.content, ensure_ascii=False),)),
}


def rows(recording: Recording) -> Iterator[tuple[Table, tuple]]:
    """Yield the table and the row of each frame of a recording, showing how far it is."""
    begun_s = recording.header.host_s
    for arrived_s, frame in shown(recording):
        table = TABLES[type(frame)]
        time_s = getattr(frame, "time_s", None)
        arrived_s = round(arrived_s - begun_s, 9)
        time_s = arrived_s if time_s is None else round(time_s - begun_s, 9)
        yield (
            table,
            (time_s, arrived_s, frame.sensor, frame.sequence, frame.t_us, *table.rest(frame)),
        )


def shown(recording: Recording, every: int = _PROGRESS_EVERY) -> Iterator:
    """Yield what a recording does, showing on a terminal how far it is."""
    columns = (
        TextColumn(printable(recording.path.name), markup=False),
        BarColumn(),
        TimeRemainingColumn(),
    )
    console = Console(stderr=True)
    quiet = not console.is_terminal
    with Progress(*columns, console=console, transient=True, disable=quiet) as progress:
        task = progress.add_task("", total=recording.size)
        for count, entry in enumerate(recording):
            if count % every == 0:
                progress.update(task, completed=recording.read_bytes)
            yield entry
