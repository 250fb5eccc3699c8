"""Converts frames to rows of tables; defines the columns of all exports."""

import heapq
import json
from collections.abc import Iterator, Sequence
from itertools import repeat
from typing import Any, NamedTuple

import msgspec
import numpy as np
from rich.console import Console
from rich.progress import BarColumn, Progress, TextColumn, TimeRemainingColumn

from spots_device.reading import decode
from spots_device.sensor.smux import CHANNELS

from ..common.cursor import cursor_shown
from ..errors import printable
from ..link.frames import DOUBTFUL, force_known, log2_unknown
from .arrays import Arrays, RecordingBlocks
from .header import Header
from .utc import Utc


class Table(NamedTuple):
    """A table of exported frames of one kind: the names and types of its columns.

    The length of a text is 0. Every table begins with the columns ``time_s`` (time of the
    measurement; if this is unknown, and for a text or a mark, the time of arrival), ``arrived_s``,
    ``sensor``, ``sequence`` and ``t_us``. The first two are in s since the recording began.
    """

    name: str
    dtype: np.dtype


class Column(NamedTuple):
    """Values of a column; where they are unknown, any number. `known` is None if all are known."""

    values: np.ndarray
    known: np.ndarray | None = None

    def cells(self) -> list[Any]:
        """Return the values as a list, with None for an unknown value."""
        cells = self.values.tolist()
        if self.known is None:
            return cells
        return [one if known else None for one, known in zip(cells, self.known.tolist())]

    def array(self) -> np.ndarray:
        """Return the values as an array, with NaN for an unknown value."""
        return self.values if self.known is None else np.where(self.known, self.values, np.nan)


_FIRST = {"time_s": "f8", "arrived_s": "f8", "sensor": "u1", "sequence": "u2", "t_us": "u4"}
_TOUCH = {
    "touching": "?",
    "trusted": "?",
    "position_um": "i4",
    "force_mN": "u2",
    "sigma_um": "f8",
    "contrast_log2": "f8",
    "brightness_log2": "f8",
    "flags": "u1",
}
_SPECTRUM = {"flags": "u1", "gain_code": "u1", "counts": "6u2"}
_CONTACT = {"id": "u1", "state": "u1", "position_um": "i4", "sigma_um": "u2", "force_mN": "u2"}
_KEY = {"page": "u1", "usage": "u2", "modifiers": "u1", "pressed": "?"}
_TEXT = {"content": "U"}
_MARK = {"mark": "U"}
# Values of frames by kind. The first four kinds are in the order of `Arrays.tables`.
VALUES = {"touch": _TOUCH, "spectrum": _SPECTRUM, "key": _KEY, "contact": _CONTACT, "text": _TEXT}
VALUES["mark"] = _MARK
_UNKNOWABLE = "touch", "contact"  # kinds with the column ``known``
_ASIDE = {"re", "boot", "layout", "keys", "gamepad"}  # in the reply to ``hello``; change no reading
Row = tuple[Table, tuple[Any, ...]]


class Description(NamedTuple):
    """The facts that the tables of a recording do not contain.

    `changes` has the settings, calibration and dark frame that the board reported during the
    recording, where they differ from those before. Each dict has ``arrived_s``, the time since the
    recording began, ``sensor``, and the new values. Settings of keys are left out. `utc` converts
    host times to UTC.
    """

    header: Header
    changes: list[dict[str, Any]]
    utc: Utc

    def begun_s(self, since_s: float) -> float:
        """Return what to add to the time `since_s` since the recording began, to get UTC."""
        return self.utc.begun_s(self.header.host_s + since_s)

    @property
    def as_json(self) -> dict[str, Any]:
        """The fields of the header, with the right ``utc_s``, and ``changes``."""
        known = {"utc_s": self.begun_s(0.0), "changes": self.changes}
        return msgspec.to_builtins(self.header) | known

    @property
    def channels(self) -> Sequence[str]:
        """Channels of the six ADCs, such as "F3"; "adc0" to "adc5" if not always the same ones."""
        plan: list[str] = self.header.info["channels"]
        always = all(
            one.get("channels", plan) == plan for one in (*self.header.strips, *self.changes)
        )
        if always and len(plan) == len(set(plan)) == CHANNELS:
            return plan
        return [f"adc{i}" for i in range(CHANNELS)]


def described(recording: RecordingBlocks) -> Description:
    """Read a recording to its end, and return the description of its tables."""
    header = recording.header
    settings = header.settings
    changes = []
    for block in recording:
        for at_s, text in block.texts:
            sensor = text.content.get("sensor", 0)  # a board sends all replies as its first strip
            if "re" not in text.content or sensor not in range(len(settings)):
                continue
            now = settings[sensor]
            reported = {
                name: text.content[name] for name in now.keys() & text.content.keys() - _ASIDE
            }
            if new := {name: value for name, value in reported.items() if now[name] != value}:
                now.update(new)
                since_s = round(at_s - header.host_s, 9)
                changes.append({"arrived_s": since_s, "sensor": sensor, **new})
    return Description(header, changes, recording.utc)


def tables(channels: Sequence[str]) -> list[Table]:
    """Return the tables of an export, with the names of the channels of the six ADCs."""
    made = []
    for name, values in VALUES.items():
        columns = _FIRST | values
        if columns.pop("counts", None):
            columns |= {f"counts_{channel}": "u2" for channel in channels}
        if name in _UNKNOWABLE:
            columns["known"] = "?"
        made.append(Table(name, np.dtype(list(columns.items()))))
    return made


def rows(recording: RecordingBlocks, channels: Sequence[str]) -> Iterator[Row]:
    """Yield rows of the tables in order of arrival; show the progress on a terminal.

    A row has a value for each column; an unknown value is None. `channels` are those of
    `Description.channels`.
    """
    begun_s = recording.header.host_s
    every = tables(channels)
    for block in shown(recording):
        found = [_rows(table, columns(table, block, begun_s)) for table in every]
        yield from heapq.merge(*found, key=lambda row: row[1][1])


def _rows(table: Table, found: dict[str, Column]) -> Iterator[Row]:
    cells = {name: found[name].cells() for name in table.dtype.names}
    if table.name == "text":
        cells["content"] = [json.dumps(one, ensure_ascii=False) for one in cells["content"]]
    return zip(repeat(table), zip(*cells.values()))


def columns(table: Table, block: Arrays, begun_s: float) -> dict[str, Column]:
    """Return the columns of a table for a block of a recording, in the table's order.

    `begun_s` is the start of the recording on the host's monotonic clock. The column ``content``
    has dicts.
    """
    of = _of_texts if table.name in ("text", "mark") else _of_readings
    found = of(table, block)
    for name in ("time_s", "arrived_s"):
        since_s = [round(one - begun_s, 9) for one in found[name].values.tolist()]
        found[name] = Column(np.array(since_s, float))
    return {name: found[name] for name in table.dtype.names}


def _of_texts(table: Table, block: Arrays) -> dict[str, Column]:
    frames: Sequence[tuple[float, tuple[Any, ...]]] = block.texts
    if table.name == "mark":
        frames = [(at_s, (0, 0, 0, text)) for at_s, text in block.marks]  # no strip, and no frame
    at_s = Column(np.array([at_s for at_s, _ in frames], float))
    found = {"time_s": at_s, "arrived_s": at_s}
    for i, name in enumerate(table.dtype.names[len(found) :]):
        dtype = object if table.dtype[name].kind == "U" else table.dtype[name]
        found[name] = Column(np.array([frame[i] for _, frame in frames], dtype))
    return found


def _of_readings(table: Table, block: Arrays) -> dict[str, Column]:
    array = block.tables[list(VALUES).index(table.name)]
    found = {name: Column(array[name]) for name in array.dtype.names}
    time_s, arrived_s = array["time_s"], array["arrived_s"]
    found["time_s"] = Column(np.where(np.isnan(time_s), arrived_s, time_s))
    if table.name == "touch":
        flags = array["flags"]
        touching = flags & decode.TOUCHING != 0
        found["touching"] = Column(touching)
        found["trusted"] = Column(touching & (flags & DOUBTFUL == 0))
        found["position_um"] = Column(array["position_um"], array["known"])
        found["force_mN"] = Column(array["force_mN"], force_known(flags))
        found["sigma_um"] = Column(array["sigma_um"], ~np.isnan(array["sigma_um"]))
        for name in ("contrast", "brightness"):
            values = array[f"{name}_q20"]
            found[f"{name}_log2"] = Column(values / (1 << 20), ~log2_unknown(values, flags))
    elif table.name == "contact":
        found["force_mN"] = Column(array["force_mN"], array["known"])
    elif table.name == "spectrum":
        found["gain_code"] = found["gain"]
        found |= zip(table.dtype.names[-CHANNELS:], map(Column, array["counts"].T))
    return found


def shown(recording: RecordingBlocks) -> Iterator[Arrays]:
    """Yield the blocks of a recording, and show the progress on a terminal."""
    name = TextColumn(printable(recording.path.name), markup=False)
    columns = name, BarColumn(), TimeRemainingColumn()
    console = Console(stderr=True)
    quiet = not console.is_terminal
    with (
        cursor_shown(console),
        Progress(*columns, console=console, transient=True, disable=quiet) as progress,
    ):
        task = progress.add_task("", total=recording.size)
        for block in recording:
            progress.update(task, completed=recording.read_bytes)
            yield block
