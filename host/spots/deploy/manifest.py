"""The manifest on a board: path and SHA-256 of every file that ``spots flash`` wrote.

When another version is flashed later, listed files that the new version does not contain are
removed, unless the user has changed them. ``sha256sum -c`` can check a manifest.
"""

import hashlib
import re

MANIFEST = "spots.sha256"
LARGEST_BYTES = 1 << 16  # largest number of bytes that are read from a board's manifest
_LINE = re.compile(rb"([0-9a-f]{64})  (\w[\w.-]*(?:/\w[\w.-]*)*)")


def entries_of(files: dict[str, bytes]) -> set[tuple[str, str]]:
    """Return the entries of a manifest: pairs of path and hexadecimal SHA-256.

    `files` has the content of each file, by its path on the board.
    """
    return {(path, hashlib.sha256(data).hexdigest()) for path, data in files.items()}


def write(entries: set[tuple[str, str]]) -> bytes:
    """Return the text of a manifest. A path may have two entries: old and new SHA-256."""
    return "".join(f"{digest}  {path}\n" for path, digest in sorted(entries)).encode()


def read(data: bytes) -> set[tuple[str, str]]:
    """Return the entries of a manifest, as `entries_of` does. Invalid lines are ignored."""
    found = map(_LINE.fullmatch, data.splitlines())
    return {(line[2].decode(), line[1].decode()) for line in found if line}
