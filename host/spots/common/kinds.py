"""Recognises the kind of a file by its content, for the error about a file of another kind."""

import os
import re
from pathlib import Path

from ..errors import FileError, SpotsError

# Kinds of binary files, by a text at their beginning.
_BEGINNINGS = {
    b"\x89MCAP": "an MCAP file",
    b"PK\x03\x04": "a ZIP or NPZ file",
    b"\x93NUMPY": "a NumPy file",
    b"UF2\n": "a UF2 file",
}
_RECORDING = b'{"header":'  # in the first note of a recording, after a few bytes of its frame
_NOTE_BYTES = 32
# Kinds of text files, by a pattern at the beginning of a line or of the file. Here and below, no
# pattern goes on over the end of a line, as \s does: the time would grow with the size squared.
_LINES = {
    r'(?m)^[ \t]*\{[^\n]*"kind":': "a session file",
    r"\A.{,200}\bx_mm\b.{,200},": "a table of points",
    r"\A(?:time_s|arrived_s),": "an exported table",
}
# Kinds of TOML files, by keys or tables that no other kind has at its top level.
_KEYS = {
    "a calibration file": {"lines", "original"},
    "a layout file": {"layer"},
    "a sensor file": {"dye", "converter"},
    "a scenario file": {"touch", "ambient", "faults"},
    "a path file": {"stroke", "speed_mm_s"},
    "a linkage file": {"bar_mm"},
    "a settings file": {"button", "hold_ms"},
    "a gestures file": {"gestures", "least_confidence"},
    "a change file": {"die_nm", "phosphor_nm", "bands_nm", "dye_percent", "temperature_K"},
    "a board file": {"runtime", "march"},
}
_TABLE = re.compile(r"^[ \t]*\[\[?[ \t]*(\w+)", re.MULTILINE)
_KEY = re.compile(r"^[ \t]*(\w+)[ \t]*=", re.MULTILINE)


def kinds_of(data: bytes | str) -> list[str]:
    """Return the kinds that a file may have, each with its article; empty if none is recognised.

    The data are the content of the file, or its beginning.
    """
    if isinstance(data, bytes):
        found = [kind for start, kind in _BEGINNINGS.items() if data.startswith(start)]
        if _RECORDING in data[: len(_RECORDING) + _NOTE_BYTES]:
            found.append("a recording")
        if found:
            return found
        data = data.decode("utf-8", "replace")
    found = [kind for pattern, kind in _LINES.items() if re.search(pattern, data)]
    if found:
        return found
    first_table = _TABLE.search(data)
    top = data[: first_table.start()] if first_table else data
    names = {*_TABLE.findall(data), *_KEY.findall(top)}
    return [kind for kind, marks in _KEYS.items() if marks & names]


def check(path: object, data: bytes | str, wanted: str) -> None:
    """FileError if a file that cannot be parsed is recognised, but not as the wanted kind.

    If its kind is unknown, the caller reports the error of parsing. `wanted` has its article, such
    as "a layout file".
    """
    found = kinds_of(data)
    if found and wanted not in found:
        raise FileError(f"{path} is {found[0]}, not {wanted}: name another file", path)


def not_read(path: str | Path, error: OSError | UnicodeDecodeError, wanted: str) -> SpotsError:
    """Return the error for a file that exists but cannot be read as text.

    `wanted` has its article, such as "a layout file".
    """
    if isinstance(error, UnicodeDecodeError):
        try:
            check(path, error.object, wanted)
        except SpotsError as other:
            return other
        return FileError(
            f"{path} is not UTF-8 text, so it is not {wanted}: save it as UTF-8, or name another "
            "file",
            path,
        )
    if os.path.isdir(path):  # Windows denies access to it
        return FileError(f"{path} is a folder, not {wanted}: name a file", path)
    return FileError(
        f"cannot read {path} ({error.strerror}): name another file, or change its permissions", path
    )
