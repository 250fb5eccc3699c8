"""What fuzzing kept of each target: regressions with a name as files, the rest in one archive."""

from __future__ import annotations

import hashlib
import zipfile
from pathlib import Path

CORPUS = Path(__file__).parent / "corpus"


def named(target: str) -> dict[str, bytes]:
    """Return the regressions of a target, by their names."""
    folder = CORPUS / target
    return {path.name: path.read_bytes() for path in sorted(folder.iterdir())}


def found(target: str) -> dict[str, bytes]:
    """Return what fuzzing found, by the SHA-1 of each."""
    try:
        with zipfile.ZipFile(CORPUS / f"{target}.zip") as archive:
            return {name: archive.read(name) for name in archive.namelist()}
    except FileNotFoundError:
        return {}


def kept(target: str) -> dict[str, bytes]:
    """Return all of it."""
    return {**named(target), **found(target)}


def keep(target: str, inputs: list[bytes]) -> None:
    """Replace what fuzzing found; the same inputs give the same archive."""
    digests = {hashlib.sha1(data).hexdigest(): data for data in inputs}
    with zipfile.ZipFile(CORPUS / f"{target}.zip", "w") as archive:
        for name, data in sorted(digests.items()):
            archive.writestr(zipfile.ZipInfo(name), data, zipfile.ZIP_DEFLATED)
