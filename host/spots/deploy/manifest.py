"""The manifest: path and SHA-256 of every file that a flash wrote, as ``sha256sum -c`` reads it.

It is stored on the board, so that another version removes these files and no others.
"""

from __future__ import annotations

import hashlib
import re

MANIFEST = "spots.sha256"
LARGEST_BYTES = 1 << 16  # of one that is read
_LINE = re.compile(rb"([0-9a-f]{64})  (\w[\w.-]*(?:/\w[\w.-]*)*)")


def entries_of(files: dict[str, bytes]) -> set[tuple[str, str]]:
    """Return (path, hash) of files."""
    return {(path, hashlib.sha256(data).hexdigest()) for path, data in files.items()}


def write(entries: set[tuple[str, str]]) -> bytes:
    """Return a manifest; while files are replaced, a path is in it with two hashes."""
    return "".join(f"{digest}  {path}\n" for path, digest in sorted(entries)).encode()


def read(data: bytes) -> set[tuple[str, str]]:
    """Return the entries of a manifest; invalid lines and paths are left out."""
    found = map(_LINE.fullmatch, data.splitlines())
    return {(line[2].decode(), line[1].decode()) for line in found if line}
