"""``spots info``: a summary of a recording."""

from datetime import datetime, timezone
from pathlib import Path

import msgspec

from ..errors import printable
from .arrays import RecordingBlocks
from .table import VALUES, shown


def summary(path: str | Path) -> dict:
    """Read a recording to its end and return its summary, as ``spots info --json`` prints it.

    ``begun`` is in UTC (ISO 8601), ``bytes`` the size of all files. ``lost`` and ``bad`` are `lost`
    and `bad_crc` of `LinkStats`; ``restarts``, ``cut_bytes``, ``complete``, ``joined`` and
    ``notes`` are those of `Recording`. FileError if the recording cannot be read.
    """
    recording = RecordingBlocks(path)
    counts = dict.fromkeys(VALUES, 0)
    for block in shown(recording):
        for name, found in zip(VALUES, (*block.tables, block.texts, block.marks)):
            counts[name] += len(found)
    stats, header = recording.stats, recording.header
    begun_s = recording.utc.begun_s(header.host_s)
    return {
        "files": [str(path) for path in recording.paths],
        "bytes": recording.size,
        "begun": datetime.fromtimestamp(begun_s, timezone.utc).isoformat(),
        "duration_s": round(recording.end_s - header.host_s, 6),
        "frames": counts,
        "lost": stats.lost,
        "bad": stats.bad_crc,
        "restarts": recording.restarts,
        "cut_bytes": recording.cut_bytes,
        "complete": recording.complete,
        "joined": recording.joined,
        "notes": recording.notes,
        "header": msgspec.to_builtins(header),
    }


def report(found: dict) -> str:
    """Return the result of `summary` as lines of text."""
    info = found["header"]["info"]
    calibration = found["header"]["calibration"]
    frames = ", ".join(f"{count} {name}" for name, count in found["frames"].items() if count)
    cut = found["cut_bytes"]
    end = "complete" if found["complete"] else "no end mark: cut off, or still being recorded"
    if found["joined"]:
        end = "data follows the end mark: two recordings were joined"
    rows = {
        "files": ", ".join(found["files"]),
        "size": f"{found['bytes']} bytes",
        "board": "{board}, {runtime}, firmware {firmware}, id {id}".format(**info),
        "calibration": f"{info['calibration']}"
        + (f", {len(calibration)} lines" if calibration else ""),
        "begun": found["begun"],
        "duration": f"{found['duration_s']:.3f} s",
        "frames": frames or "none",
        "lost": f"{found['lost']} lost, {found['bad']} bad, {found['restarts']} restarts",
        "end": end + (f", {cut} bytes of a frame" if cut else ""),
    }
    width = max(map(len, rows))
    return "\n".join(f"{name.ljust(width)}  {printable(value)}" for name, value in rows.items())
