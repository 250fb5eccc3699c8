"""``spots export``: a recording as a file for other programs."""

from __future__ import annotations

import csv
import json
import os
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager
from pathlib import Path

import msgspec
import numpy as np

from ..errors import SpotsError
from .reader import Recording
from .table import Table, rows

_ROWS_AT_ONCE = 1 << 16


def export(path: str | Path, kind: str, out: str | Path | None = None) -> list[Path]:
    """Write a recording, or a set of them, in another format.

    Parameters
    ----------
    path : str or Path
        The recording.
    kind : str
        One of `EXPORTS`.
    out : str or Path, optional
        The new file, the recording's name with another suffix if not given. CSV is a file for
        each kind of frame: NAME-touch.csv, NAME-spectrum.csv, ...

    Returns
    -------
    list of Path
        The new files.

    Raises
    ------
    SpotsError
        If the recording cannot be read, or a file is already there or cannot be written; then
        nothing is.
    """
    recording = Recording(path)
    out = Path(out) if out else recording.path.with_suffix("." + kind)
    with ExitStack() as stack:
        files = _Files(stack)
        EXPORTS[kind](recording, out, files)
    return files.paths


class _Files:
    """New files, which are there when all of them are whole, or never were."""

    def __init__(self, stack: ExitStack):
        self._stack = stack
        self.paths: list[Path] = []

    def new(self, path: Path, mode: str = "wb", **options):
        if path.exists():
            raise SpotsError(f"{path} exists: choose another name with --out or remove it")
        file = self._stack.enter_context(_new(path, mode, options))
        self.paths.append(path)
        return file


@contextmanager
def _new(path: Path, mode: str, options: dict) -> Iterator:
    part = path.with_name(path.name + ".part")
    try:
        with open(part, mode, **options) as file:
            yield file
        os.replace(part, path)
    except OSError as error:
        raise SpotsError(f"{path} cannot be written: {error.strerror}") from None
    finally:
        part.unlink(missing_ok=True)


def _csv(recording: Recording, out: Path, files: _Files) -> None:
    writers: dict[str, Callable] = {}
    stem = out.stem if out.suffix == ".csv" else out.name  # what else has a dot is part of the name
    for table, row in rows(recording):
        write = writers.get(table.name)
        if write is None:
            path = out.with_name(f"{stem}-{table.name}.csv")
            file = files.new(path, "w", newline="", encoding="utf-8")
            write = writers[table.name] = csv.writer(file).writerow
            write(_flat_names(table))
        write(_flat(row))


def _flat_names(table: Table) -> list[str]:
    names = []
    for name, dtype in table.columns.items():
        count = dtype[1][0] if isinstance(dtype, tuple) else None
        names += [name] if count is None else [f"{name}_adc{i}" for i in range(count)]
    return names


def _flat(row: tuple) -> list:
    cells = []
    for value in row:
        if isinstance(value, tuple):
            cells += value
        else:
            cells.append(int(value) if isinstance(value, bool) else value)
    return cells


def _npz(recording: Recording, out: Path, files: _Files) -> None:
    waiting: dict[str, list] = {}
    done: dict[str, list] = {}
    tables: dict[str, Table] = {}

    def pack(name: str) -> None:
        found = waiting.pop(name)
        done.setdefault(name, []).append(np.array(found, _dtype(tables[name], found)))

    file = files.new(out)
    for table, row in rows(recording):
        tables[table.name] = table
        column = waiting.setdefault(table.name, [])
        column.append(row)
        if len(column) == _ROWS_AT_ONCE:
            pack(table.name)
    for name in list(waiting):
        pack(name)
    arrays = {name: np.concatenate(parts) for name, parts in done.items()}
    header = np.array(msgspec.json.encode(recording.header).decode())
    np.savez_compressed(file, header=header, **arrays)


def _dtype(table: Table, found: list[tuple]) -> np.dtype:
    fields = []
    for i, (name, dtype) in enumerate(table.columns.items()):
        if dtype == "U":
            dtype = f"U{max(len(row[i]) for row in found)}"
        fields.append((name, *dtype) if isinstance(dtype, tuple) else (name, dtype))
    return np.dtype(fields)


def _mcap(recording: Recording, out: Path, files: _Files) -> None:
    try:
        from mcap.writer import Writer
    except ImportError:
        raise SpotsError(
            "exporting to MCAP needs another package: pip install 'spots[export]'"
        ) from None
    from .foxglove import LOG_SCHEMA, log_message, schema

    header = recording.header
    begun_ns = round(1e9 * header.utc_s)
    writer = Writer(files.new(out))
    writer.start(profile="", library=header.program)
    writer.add_metadata("spots", _metadata(msgspec.to_builtins(header)))
    channels: dict[tuple, int] = {}

    def channel(table: Table, sensor: int) -> int:
        if table.name == "text":
            name, topic, content = "foxglove.Log", "/spots/log", LOG_SCHEMA
        else:
            name, topic = f"spots.{table.name.capitalize()}", f"/spots/{sensor}/{table.name}"
            content = schema(table)
        data = json.dumps(content).encode()
        return writer.register_channel(
            topic, "json", writer.register_schema(name, "jsonschema", data)
        )

    encode = msgspec.json.Encoder().encode
    for table, row in rows(recording):
        time_s, _, sensor, sequence = row[:4]
        key = table.name, sensor
        if key not in channels:
            channels[key] = channel(table, sensor)
        time_ns = max(0, begun_ns + round(1e9 * time_s))
        if table.name == "text":
            message = log_message(time_ns, row[-1], header.info.get("board", ""))
        else:
            message = dict(zip(table.columns, row))
        writer.add_message(channels[key], time_ns, encode(message), time_ns, sequence)
    writer.finish()


def _metadata(values: dict) -> dict[str, str]:
    return {
        name: value if isinstance(value, str) else json.dumps(value)
        for name, value in values.items()
    }


EXPORTS = {"mcap": _mcap, "csv": _csv, "npz": _npz}
