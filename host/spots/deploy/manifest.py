"""The manifest on a board: path and SHA-256 of every file that a flash wrote.

A later flash of another version removes exactly these files. ``sha256sum -c`` can check a manifest.
"""

import hashlib
import re

MANIFEST = "spots.sha256"
LARGEST_BYTES = 1 << 16  # at most so many bytes of a board's manifest are read
_LINE = re.compile(rb"([0-9a-f]{64})  (\w[\w.-]*(?:/\w[\w.-]*)*)")


def entries_of(files: dict[str, bytes]) -> set[tuple[str, str]]:
    """Return the entries of a manifest for these files: pairs of path and SHA-256 (hexadecimal)."""
    return {(path, hashlib.sha256(data).hexdigest()) for path, data in files.items()}


def write(entries: set[tuple[str, str]]) -> bytes:
    """Return the text of a manifest. A file that is being replaced has two entries."""
    return "".join(f"{digest}  {path}\n" for path, digest in sorted(entries)).encode()


def read(data: bytes) -> set[tuple[str, str]]:
    """Return the entries of a manifest. Invalid lines and paths are ignored."""
    found = map(_LINE.fullmatch, data.splitlines())
    return {(line[2].decode(), line[1].decode()) for line in found if line}
