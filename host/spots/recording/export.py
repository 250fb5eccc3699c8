"""``spots export``: a recording as a file for other programs."""

from __future__ import annotations

import csv
import json
import tempfile
import zipfile
from collections.abc import Callable, Iterable, Iterator
from contextlib import ExitStack
from pathlib import Path
from typing import IO

import msgspec
import numpy as np
from numpy.lib import format as npy

from ..atomic import replacing, sync
from ..errors import SpotsError, missing
from .arrays import RecordingBlocks
from .foxglove import LOG_SCHEMA, log_message, schema
from .header import Header
from .table import Table, rows

# Rows of a table in memory: few, so that an export takes the same for any length.
_BLOCK_ROWS = 1024
Records = Iterable[tuple[Table, tuple]]


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

    Notes
    -----
    It takes the same memory whatever the recording's length. NPZ takes room on the medium twice.
    """
    recording = RecordingBlocks(path)
    out = Path(out) if out else recording.path.with_suffix("." + kind)
    with ExitStack() as stack:
        files = _Files(stack)
        EXPORTS[kind](recording.header, rows(recording), out, files)
        files.sync()
    return files.paths


class _Files:
    """New files, which are there when all of them are whole, or never were."""

    def __init__(self, stack: ExitStack):
        self._stack = stack
        self._files: list[IO] = []
        self.paths: list[Path] = []

    def new(self, path: Path, kind: str = "b", **options) -> IO:
        file = self._stack.enter_context(replacing(path, kind, new=True, **options))
        self._files.append(file)
        self.paths.append(path)
        return file

    def sync(self) -> None:
        """Flush all files to the medium before the first one is renamed."""
        for path, file in zip(self.paths, self._files):
            try:
                sync(file)
            except OSError as error:
                raise SpotsError(f"cannot write {path}: {error.strerror}") from None


def _csv(header: Header, records: Records, out: Path, files: _Files) -> None:
    writers: dict[str, Callable] = {}
    stem = out.stem if out.suffix == ".csv" else out.name  # what else has a dot is part of the name
    for table, row in records:
        write = writers.get(table.name)
        if write is None:
            path = out.with_name(f"{stem}-{table.name}.csv")
            file = files.new(path, "t", newline="", encoding="utf-8")
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


def _npz(header: Header, records: Records, out: Path, files: _Files) -> None:
    file = files.new(out)
    with ExitStack() as stack, zipfile.ZipFile(file, "w", zipfile.ZIP_DEFLATED) as archive:
        spools: dict[str, _Spool] = {}
        for name, block in _blocks(records):
            if name not in spools:
                # In the folder of the file: where temporary files are may be memory.
                spool = stack.enter_context(tempfile.TemporaryFile(dir=out.parent))
                spools[name] = _Spool(spool)
            spools[name].add(block)
        with archive.open("header.npy", "w") as member:
            npy.write_array(member, np.array(msgspec.json.encode(header).decode()))
        for name, spool in spools.items():
            with archive.open(f"{name}.npy", "w", force_zip64=True) as member:
                spool.write(member)


class _Spool:
    """Blocks of a table, on disk until length and type of the whole table are known."""

    def __init__(self, file: IO):
        self._file = file
        self._blocks = self._rows = 0
        self._dtype: np.dtype | None = None

    def add(self, block: np.ndarray) -> None:
        npy.write_array(self._file, block)
        self._blocks += 1
        self._rows += len(block)
        known = self._dtype
        self._dtype = block.dtype if known is None else np.promote_types(known, block.dtype)

    def write(self, member: IO) -> None:
        descr = npy.dtype_to_descr(self._dtype)
        shape = {"descr": descr, "fortran_order": False, "shape": (self._rows,)}
        npy.write_array_header_1_0(member, shape)
        self._file.seek(0)
        for _ in range(self._blocks):
            member.write(npy.read_array(self._file).astype(self._dtype).tobytes())


def _blocks(records: Records) -> Iterator[tuple[str, np.ndarray]]:
    """Yield the rows of each table as arrays of at most `_BLOCK_ROWS` rows, by its name."""
    waiting: dict[str, list[tuple]] = {}
    tables: dict[str, Table] = {}
    for table, row in records:
        tables[table.name] = table
        found = waiting.setdefault(table.name, [])
        found.append(row)
        if len(found) == _BLOCK_ROWS:
            yield table.name, np.array(found, _dtype(table, found))
            found.clear()
    for name, found in waiting.items():
        if found:
            yield name, np.array(found, _dtype(tables[name], found))


def _dtype(table: Table, found: list[tuple]) -> np.dtype:
    fields = []
    for i, (name, dtype) in enumerate(table.columns.items()):
        if dtype == "U":
            dtype = f"U{max(len(row[i]) for row in found)}"
        fields.append((name, *dtype) if isinstance(dtype, tuple) else (name, dtype))
    return np.dtype(fields)


def _mcap(header: Header, records: Records, out: Path, files: _Files) -> None:
    try:
        from mcap.writer import Writer
    except ImportError:
        raise missing("exporting to MCAP needs", "mcap", "export") from None

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
    for table, row in records:
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
