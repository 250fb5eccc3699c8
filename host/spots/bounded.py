"""Files read within bounds: regular files only, of a size that their kind can have."""

from __future__ import annotations

import os
import stat
from pathlib import Path
from typing import BinaryIO

from .errors import SpotsError

# Several times the longest file of its kind that has a purpose.
TOML_MAX_BYTES = 256 << 10  # read by pure Python: about 1 MB/s
POINTS_MAX_BYTES = 1 << 20  # places of a linkage: some 15 000
SESSION_MAX_BYTES = 16 << 20  # presses: some 30 000
ZENOH_MAX_BYTES = 1 << 20


def open_regular(path: str | Path) -> BinaryIO:
    """Open a file to read it. It neither blocks nor touches a device.

    Raises
    ------
    OSError
        If it cannot be opened.
    SpotsError
        If it is a pipe, a device or a socket, or a link to one.
    """
    _check_regular(path, os.stat(path).st_mode)  # to open a device can be enough to disturb it
    file = open(path, "rb", opener=_without_blocking)
    try:
        _check_regular(path, os.fstat(file.fileno()).st_mode)
    except SpotsError:
        file.close()
        raise
    return file


def read_bytes(path: str | Path, max_bytes: int) -> bytes:
    """Return the content of a file.

    Parameters
    ----------
    path : str or Path
        Of a regular file.
    max_bytes : int
        Largest size that is read, in bytes.

    Returns
    -------
    bytes

    Raises
    ------
    OSError
        If it cannot be read.
    SpotsError
        If it is not a regular file, or larger than `max_bytes`.
    """
    with open_regular(path) as file:
        size = os.fstat(file.fileno()).st_size
        data = file.read(max_bytes + 1) if size <= max_bytes else b""
    if max(size, len(data)) > max_bytes:
        raise SpotsError(
            f"{path} is larger than {max_bytes >> 10} KiB, more than such a file can need: name "
            "another file"
        )
    return data


def read_text(path: str | Path, max_bytes: int = TOML_MAX_BYTES, encoding: str = "utf-8") -> str:
    r"""Return the content of a text file, its line ends as ``\n``; see `read_bytes`.

    Parameters
    ----------
    path : str or Path
        Of a regular file.
    max_bytes : int
        Largest size that is read, in bytes.
    encoding : str
        As for `bytes.decode`.

    Returns
    -------
    str

    Raises
    ------
    UnicodeDecodeError
        If it is not text in this encoding.
    """
    text = read_bytes(path, max_bytes).decode(encoding)
    return text.replace("\r\n", "\n").replace("\r", "\n")


def _without_blocking(path: str, flags: int) -> int:
    # Not on Windows, which has no named pipes among its files.
    return os.open(path, flags | getattr(os, "O_NONBLOCK", 0) | getattr(os, "O_NOCTTY", 0))


def _check_regular(path: str | Path, mode: int) -> None:
    if not stat.S_ISREG(mode) and not stat.S_ISDIR(mode):  # a folder: see the caller's `OSError`
        raise SpotsError(f"{path} is not a regular file: name another file")
