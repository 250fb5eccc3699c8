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

from ..errors import printable
from ..link.frames import DOUBTFUL, Text, force_known, log2_unknown
from .arrays import Arrays, RecordingBlocks
from .header import Header
from .recording import Mark


class Table(NamedTuple):
    """A table of exported frames of one kind: its name and its columns.

    Attributes
    ----------
    name : str
        Name of the table, and of the kind of frames.
    dtype : numpy.dtype
        Names and types of the columns; the length of a text is 0. Every table begins with the
        columns ``time_s`` (time of the measurement; if this is unknown, and for a text or a mark,
        the time of arrival), ``arrived_s``, ``sensor``, ``sequence`` and ``t_us``. The first two
        are in s since the recording began.
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
_MARK = {"mark": "U"}
# Values of frames by kind. The first four kinds are in the order of `Arrays.tables`.
VALUES = {"touch": _TOUCH, "spectrum": _SPECTRUM, "key": _KEY, "contact": _CONTACT, "text": _TEXT}
VALUES["mark"] = _MARK
_UNKNOWABLE = "touch", "contact"  # kinds with the column ``known``
_ASIDE = {"re", "boot", "layout", "keys", "gamepad"}  # in the reply to ``hello``; change no reading
Row = tuple[Table, tuple[Any, ...]]


class Description(NamedTuple):
    """The facts that the tables of a recording do not contain.

    Attributes
    ----------
    header : Header
        Header of the recording.
    changes : list of dict
        Settings, calibration and dark frame that the board reported during the recording, where
        they differ from those before. Each dict has ``arrived_s``, the time since the recording
        began, ``sensor``, and the new values. Settings of keys are left out.
    """

    header: Header
    changes: list[dict[str, Any]]

    @property
    def as_json(self) -> dict[str, Any]:
        """The fields of the header, and ``changes``."""
        return msgspec.to_builtins(self.header) | {"changes": self.changes}

    @property
    def channels(self) -> Sequence[str]:
        """Channels of the six ADCs, such as "F3"; "adc0" to "adc5" if not always the same ones."""
        plan: list[str] = self.header.info["plan"]
        always = all(one.get("plan", plan) == plan for one in (*self.header.strips, *self.changes))
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
            if "re" not in text.content or text.sensor >= len(settings):
                continue
            now = settings[text.sensor]
            reported = {
                name: text.content[name] for name in now.keys() & text.content.keys() - _ASIDE
            }
            if new := {name: value for name, value in reported.items() if now[name] != value}:
                now.update(new)
                since_s = round(at_s - header.host_s, 9)
                changes.append({"arrived_s": since_s, "sensor": text.sensor, **new})
    return Description(header, changes)


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

    Parameters
    ----------
    recording : RecordingBlocks
        The recording to export.
    channels : sequence of str
        Names of the channels of the six ADCs, see `Description.channels`.

    Yields
    ------
    tuple
        Table, and a tuple with a value for each column; an unknown value is None.
    """
    begun_s = recording.header.host_s
    *kinds, texts, marks = tables(channels)
    for block in shown(recording):
        found = [_array_rows(*pair, begun_s) for pair in zip(kinds, block.tables)]
        found.append(_text_rows(texts, block.texts, begun_s))
        found.append(_mark_rows(marks, block.marks, begun_s))
        yield from heapq.merge(*found, key=lambda row: row[1][1])


def _array_rows(table: Table, array: np.ndarray, begun_s: float) -> Iterator[Row]:
    arrived_s = [round(one - begun_s, 9) for one in array["arrived_s"].tolist()]
    times_s = zip(array["time_s"].tolist(), arrived_s)
    columns = {name: array[name].tolist() for name in array.dtype.names}
    columns["arrived_s"] = arrived_s
    columns["time_s"] = [late if one != one else round(one - begun_s, 9) for one, late in times_s]
    if table.name == "touch":
        flags = array["flags"]
        touching = flags & decode.TOUCHING != 0
        columns["touching"] = touching.tolist()
        columns["trusted"] = (touching & (flags & DOUBTFUL == 0)).tolist()
        columns["position_um"] = _known(array["position_um"], array["known"])
        columns["force_mN"] = _known(array["force_mN"], force_known(flags))
        for name in ("contrast", "brightness"):
            values = array[f"{name}_q20"]
            columns[f"{name}_log2"] = _known(values / (1 << 20), ~log2_unknown(values, flags))
    elif table.name == "contact":
        columns["force_mN"] = _known(array["force_mN"], array["known"])
    elif table.name == "spectrum":
        columns["gain_code"] = columns["gain"]
        counts = array["counts"].T.tolist()
        columns |= dict(zip(table.dtype.names[-CHANNELS:], counts))
    return zip(repeat(table), zip(*(columns[name] for name in table.dtype.names)))


def _known(values: np.ndarray, known: np.ndarray) -> list[Any]:
    return [one if is_known else None for one, is_known in zip(values.tolist(), known.tolist())]


def _text_rows(table: Table, texts: list[tuple[float, Text]], begun_s: float) -> Iterator[Row]:
    for at_s, text in texts:
        arrived_s = round(at_s - begun_s, 9)
        content = json.dumps(text.content, ensure_ascii=False)
        yield table, (arrived_s, arrived_s, text.sensor, text.sequence, text.t_us, content)


def _mark_rows(table: Table, marks: list[Mark], begun_s: float) -> Iterator[Row]:
    for one in marks:
        at_s = round(one.time_s - begun_s, 9)
        yield table, (at_s, at_s, 0, 0, 0, one.text)  # no strip, and no frame


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
