"""``spots export``: converts a recording to files for other programs."""

import csv
import json
import math
import pickle
import tempfile
import zipfile
from collections.abc import Callable, Iterable
from contextlib import ExitStack, suppress
from functools import cache
from pathlib import Path
from typing import IO, NamedTuple

import msgspec
import numpy as np
from numpy.lib import format as npy

from ..common.atomic import not_written, replacing, sync
from ..common.plugins import entry_points
from ..errors import SettingError, did_you_mean, missing, path_text
from .arrays import RecordingBlocks
from .foxglove import LOG_SCHEMA, log_message, schema
from .table import Description, Table, described, rows

# Number of rows of a table in memory; so memory use does not grow with the recording.
_BLOCK_ROWS = 1024
_ADDED = "export."  # how names of entry points for formats begin
Records = Iterable[tuple[Table, tuple]]


class Format(NamedTuple):
    """A format of exports.

    Attributes
    ----------
    suffix : str
        Ending of the names of its files.
    write : callable
        ``write(description, records, out, files)`` writes a recording: facts about it, rows of its
        tables, the name of the new file, and the `Files` that opens it.
    """

    suffix: str
    write: Callable[[Description, Records, Path, "Files"], None]


def _format(kind: str) -> Format:
    """Return the format of a name; load it, if an entry point ``export.NAME`` adds it."""
    if kind in EXPORTS:
        return EXPORTS[kind]
    others = entry_points(group="spots.commands")
    added = {one.name[len(_ADDED) :]: one for one in others if one.name.startswith(_ADDED)}
    if kind not in added:
        hint = did_you_mean(kind, (*EXPORTS, *added))
        raise SettingError(f"there is no format {kind!r}: {hint}")
    return added[kind].load()


def _quiet(doubts: list[str]) -> None:
    pass


def export(path: str | Path, kind: str, out: str | Path | None = None, warn=_quiet) -> list[Path]:
    """Convert a recording to another format.

    Parameters
    ----------
    path : str or Path
        File of the recording. If this is the first of several files of one recording, the other
        files are converted too.
    kind : str
        Name of the format: ``mcap``, ``csv``, ``npz``, or one that another package adds.
    out : str or Path, optional
        Name of the new file; the default is the recording's name with another suffix. CSV makes
        one file for each kind of frame: NAME-touch.csv, NAME-spectrum.csv, ..., and
        NAME-header.json with the board, its settings and its dark frame.
    warn : callable, optional
        ``warn(doubts)`` is called at the end with what is wrong with the recording, see
        `Recording.doubts`.

    Returns
    -------
    list of Path
        The new files.

    Raises
    ------
    FileError
        If the recording cannot be read, or a new file already exists or cannot be written. On any
        error, no file is written.
    SettingError
        If there is no such format, or `out` ends like another one.
    RequirementError
        If a package for the format is missing.

    Notes
    -----
    Memory use does not grow with the length of the recording. While an NPZ file is written,
    temporary files take about twice its size in the same folder.
    """
    form = _format(kind)
    if out is not None:
        out = path_text(out, "the name of an export")
    named = Path(out or "").suffix[1:].lower()
    if named in EXPORTS and named != form.suffix:
        raise SettingError(
            f"{out} is the name of a {named} file, but the format is {kind}: choose one of them"
        )
    recording = RecordingBlocks(path)
    out = Path(out) if out else recording.path.with_suffix("." + form.suffix)
    with Files() as files:
        description = described(recording)
        form.write(description, rows(recording, description.channels), out, files)
        paths = files.sync()
    warn(recording.doubts)
    return paths


class Files(ExitStack):
    """New files that are written atomically: on an error, none of them is created."""

    def __init__(self):
        super().__init__()
        self._files: dict[Path, IO] = {}

    def new(self, path: Path, kind: str = "b", **options) -> IO:
        """Open a new file, with bytes or text (``b`` or ``t``); the options are those of `open`."""
        file = self.enter_context(replacing(path, None, kind, **options))
        self._files[path] = file
        return file

    def sync(self) -> list[Path]:
        """Flush all files to the storage medium, and return their paths.

        Call this before the end of the ``with`` block, because there the files get their names.
        """
        for path, file in self._files.items():
            try:
                sync(file)
            except OSError as error:
                raise not_written(path, error) from None
        return list(self._files)


def _csv(description: Description, records: Records, out: Path, files: Files) -> None:
    writers: dict[str, Callable] = {}
    stem = out.stem if out.suffix == ".csv" else out.name  # any other suffix is a part of the name
    for table, row in records:
        write = writers.get(table.name)
        if write is None:
            path = out.with_name(f"{stem}-{table.name}.csv")
            file = files.new(path, "t", newline="", encoding="utf-8")
            write = writers[table.name] = csv.writer(file).writerow
            write(table.dtype.names)
        write([int(cell) if isinstance(cell, bool) else cell for cell in row])
    header = files.new(out.with_name(f"{stem}-header.json"), "t", encoding="utf-8")
    json.dump(description.as_json, header, indent=1)
    header.write("\n")


def _npz(description: Description, records: Records, out: Path, files: Files) -> None:
    file = files.new(out)
    with ExitStack() as stack, zipfile.ZipFile(file, "w", zipfile.ZIP_DEFLATED) as archive:
        spools: dict[str, _Spool] = {}
        for table, row in records:
            if table.name not in spools:
                # In the folder of the new file: the folder for temporary files may be in memory.
                spool = stack.enter_context(tempfile.TemporaryFile(dir=out.parent))
                spools[table.name] = _Spool(table, spool)
            spools[table.name].add(row)
        with archive.open("header.npy", "w") as member:
            npy.write_array(member, np.array(json.dumps(description.as_json)))
        for name, spool in spools.items():
            with archive.open(f"{name}.npy", "w", force_zip64=True) as member:
                spool.write(member)


class _Spool:
    """Stores rows of a table on disk until their number, which an array starts with, is known."""

    def __init__(self, table: Table, file: IO):
        self._table, self._file = table, file
        kinds = [table.dtype[name].kind for name in table.dtype.names]
        self._unknown = [math.nan if kind == "f" else 0 for kind in kinds]
        self._rows: list[tuple] = []
        self._count = self._longest = 0

    def add(self, row: tuple) -> None:
        self._rows.append(row)
        if isinstance(row[-1], str):
            self._longest = max(self._longest, len(row[-1]))
        if len(self._rows) == _BLOCK_ROWS:
            self._flush()

    def write(self, member: IO) -> None:
        """Write the table to an open file of an NPZ archive, as an array in NumPy's format."""
        self._flush()
        # Aligned: PyTorch and others refuse a stride that is not a multiple of the column's size.
        columns = [(name, self._table.dtype[name]) for name in self._table.dtype.names]
        text = np.dtype(f"U{self._longest}")
        dtype = np.dtype([(n, text if one.kind == "U" else one) for n, one in columns], align=True)
        descr = npy.dtype_to_descr(dtype)
        head = {"descr": descr, "fortran_order": False, "shape": (self._count,)}
        npy.write_array_header_1_0(member, head)
        self._file.seek(0)
        with suppress(EOFError):
            while True:
                rows = [self._filled(row) for row in pickle.load(self._file)]
                array = np.zeros(len(rows), dtype)  # zeros between the columns, too
                array[:] = rows
                member.write(array.tobytes())

    def _filled(self, row: tuple) -> tuple:
        """Replace unknown values by 0, or by NaN in a column of floats."""
        if None not in row:
            return row
        pairs = zip(row, self._unknown)
        return tuple(other if value is None else value for value, other in pairs)

    def _flush(self) -> None:
        pickle.dump(self._rows, self._file)
        self._count += len(self._rows)
        self._rows.clear()


def _mcap(description: Description, records: Records, out: Path, files: Files) -> None:
    try:
        from mcap.writer import Writer
    except ImportError:
        raise missing("exporting to MCAP needs", "mcap", "export") from None

    header = description.header
    writer = Writer(files.new(out))
    writer.start(profile="", library=header.program)
    facts = description.as_json.items()
    texts = {name: one if isinstance(one, str) else json.dumps(one) for name, one in facts}
    writer.add_metadata("spots", texts)

    @cache
    def channel(table: Table, sensor: int) -> int:
        if table.name == "text":
            name, topic, content = "foxglove.Log", "/spots/log", LOG_SCHEMA
        else:
            name, topic = f"spots.{table.name.capitalize()}", f"/spots/{sensor}/{table.name}"
            if table.name == "mark":
                topic = "/spots/marks"
            content = schema(table)
        data = json.dumps(content).encode()
        return writer.register_channel(
            topic, "json", writer.register_schema(name, "jsonschema", data)
        )

    encode = msgspec.json.Encoder().encode
    for table, row in records:
        time_s, arrived_s, sensor, sequence = row[:4]
        time_ns = max(0, round(1e9 * description.begun_s(arrived_s)) + round(1e9 * time_s))
        if table.name == "text":
            message = log_message(time_ns, row[-1], header.info.get("board", ""))
        else:
            pairs = zip(table.dtype.names, row)
            message = {name: value for name, value in pairs if value is not None}
        number = channel(table, sensor)
        writer.add_message(number, time_ns, encode(message), time_ns, sequence)
    writer.finish()


_OURS = Format("mcap", _mcap), Format("csv", _csv), Format("npz", _npz)
EXPORTS = {one.suffix: one for one in _OURS}
