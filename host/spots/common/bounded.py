"""Reads regular files up to a size limit."""

import codecs
import os
import stat
from pathlib import Path
from typing import BinaryIO

from ..errors import FileError, SpotsError, path_text

# Size limits. Each limit is several times the largest useful file of its kind.
TOML_MAX_BYTES = 256 << 10  # parsed by pure Python at about 1 MB/s
POINTS_MAX_BYTES = 1 << 20  # about 15,000 points of a linkage
SESSION_MAX_BYTES = 16 << 20  # thousands of presses by hand
ZENOH_MAX_BYTES = 1 << 20

# Byte order marks, which some editors of Windows write at the beginning of a file.
_ENCODINGS = {
    codecs.BOM_UTF8: "utf-8",
    codecs.BOM_UTF16_LE: "utf-16-le",
    codecs.BOM_UTF16_BE: "utf-16-be",
}

# Flags to open a file without blocking. Windows has neither flag, and no named pipes among its
# files.
_FLAGS = getattr(os, "O_NONBLOCK", 0) | getattr(os, "O_NOCTTY", 0)


def open_regular(path: str | Path) -> BinaryIO:
    """Open a regular file for reading; never block on a pipe, and never open a device.

    OSError if the file cannot be opened; FileError if the path names a pipe, a device or a socket,
    or a link to one.
    """
    path = path_text(path, "the path of a file")
    _check_regular(path, os.stat(path).st_mode)  # opening a device can be enough to disturb it
    file = open(path, "rb", opener=lambda path, flags: os.open(path, flags | _FLAGS))
    try:
        _check_regular(path, os.fstat(file.fileno()).st_mode)
    except SpotsError:
        file.close()
        raise
    return file


def read_bytes(path: str | Path, max_bytes: int) -> bytes:
    """Return the content of a file whose size has a limit.

    OSError if the file cannot be read; FileError if it is not a regular file, or is larger.
    """
    with open_regular(path) as file:
        data = file.read(max_bytes + 1)
    if len(data) > max_bytes:
        raise FileError(
            f"{path} is larger than {max_bytes >> 10} KiB, the limit for such a file: name another "
            "file",
            path,
        )
    return data


def read_text(path: str | Path, max_bytes: int = TOML_MAX_BYTES) -> str:
    r"""Return the content of a text file with ``\n`` as line ends; see `read_bytes`.

    UnicodeDecodeError if the file is not text, see `encoding_of`.
    """
    data = read_bytes(path, max_bytes)
    mark, encoding = encoding_of(data)
    text = data[len(mark) :].decode(encoding)
    return text.replace("\r\n", "\n").replace("\r", "\n")


def encoding_of(data: bytes) -> tuple[bytes, str]:
    """Return a text file's byte order mark (or b""), and the encoding of the rest.

    The encoding is UTF-16 if the mark shows it, else UTF-8.
    """
    for mark, encoding in _ENCODINGS.items():
        if data.startswith(mark):
            return mark, encoding
    return b"", "utf-8"


def _check_regular(path: str | Path, mode: int) -> None:
    # Opening a folder raises an `OSError` that names the reason.
    if not stat.S_ISREG(mode) and not stat.S_ISDIR(mode):
        raise FileError(f"{path} is not a regular file: name another file", path)
