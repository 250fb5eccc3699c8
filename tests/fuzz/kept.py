"""Stored inputs of each fuzz target: named regressions as files, all others in a zip archive."""

from __future__ import annotations

import hashlib
import zipfile
from pathlib import Path

CORPUS = Path(__file__).parent / "corpus"


def named(target: str) -> dict[str, bytes]:
    """Return the named regressions of a fuzz target, as a dict of contents by file name."""
    folder = CORPUS / target
    return {path.name: path.read_bytes() for path in sorted(folder.iterdir())}


def found(target: str) -> dict[str, bytes]:
    """Return the inputs that fuzzing found for a target, as a dict of contents by their SHA-1."""
    try:
        with zipfile.ZipFile(CORPUS / f"{target}.zip") as archive:
            return {name: archive.read(name) for name in archive.namelist()}
    except FileNotFoundError:
        return {}


def kept(target: str) -> dict[str, bytes]:
    """Return all stored inputs of a fuzz target, as a dict of contents by name."""
    return {**named(target), **found(target)}


def keep(target: str, inputs: list[bytes]) -> None:
    """Replace the inputs that fuzzing found for a target; the same inputs give the same archive."""
    digests = {hashlib.sha1(data).hexdigest(): data for data in inputs}
    with zipfile.ZipFile(CORPUS / f"{target}.zip", "w") as archive:
        for name, data in sorted(digests.items()):
            archive.writestr(zipfile.ZipInfo(name), data, zipfile.ZIP_DEFLATED)
