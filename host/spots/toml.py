"""The standard library's TOML reader, or its forerunner on Python 3.10; files of checked keys."""

from __future__ import annotations

import math
import os
import sys
from pathlib import Path
from typing import TypeVar

import msgspec

from .errors import SpotsError

if sys.version_info >= (3, 11):
    import tomllib
else:
    import tomli as tomllib

_Kind = TypeVar("_Kind")


def find(name: str | Path, folder: Path, what: str) -> tuple[Path, str]:
    """Return path and text of a file, by its path or by the name of one in the folder.

    Raises
    ------
    SpotsError
        If there is none; the text says which names there are.
    """
    path = Path(name)
    if not path.suffix:
        path = folder / f"{name}.toml"
    try:
        return path, path.read_text(encoding="utf-8")
    except (OSError, UnicodeDecodeError):
        known = ", ".join(sorted(file.stem for file in folder.glob("*.toml")))
        raise SpotsError(
            f"cannot read the {what} file {name}: give a path that ends in .toml, or one of {known}"
        ) from None


def loads(text: str) -> dict:
    """Return what a file says.

    Raises
    ------
    msgspec.ValidationError
        If it is not TOML, or says what no file of ours has reason to: a number that is not
        finite, a character that does something to a terminal.
    """
    try:
        content = tomllib.loads(text, parse_float=_finite)
        _check_strings(content)
    except RecursionError:
        raise msgspec.ValidationError("tables or lists are nested too deep") from None
    except ValueError as error:  # TOMLDecodeError is one; a number of too many digits is another
        raise msgspec.ValidationError(str(error)) from None
    return content


def checked(text: str, kind: type[_Kind], what: str) -> _Kind:
    """Return what a file says as a `msgspec.Struct`.

    Parameters
    ----------
    text : str
        The file.
    kind : type
        The struct.
    what : str
        Which file, for the sentence that says what is wrong with it.

    Raises
    ------
    SpotsError
        If it is not TOML, or a key in it is unknown, missing or out of range.
    """
    try:
        return msgspec.convert(loads(text), kind)
    except msgspec.ValidationError as error:
        raise SpotsError(f"{what}: {error}") from None


def save(text: str, path: str | Path) -> None:
    """Write a file, or replace it: at every moment the old one or the new one is whole.

    Raises
    ------
    SpotsError
        If it cannot be written; then what was there still is.
    """
    beside = Path(f"{path}.new")
    try:
        file = open(beside, "w", encoding="utf-8", newline="\n")
        try:
            with file:
                file.write(text)
                file.flush()
                os.fsync(file.fileno())
            os.replace(beside, path)
        finally:
            beside.unlink(missing_ok=True)
    except OSError as error:
        raise SpotsError(f"cannot write {path}: {error.strerror}") from None


def _finite(text: str) -> float:
    value = float(text)
    if not math.isfinite(value):
        raise ValueError(f"'{text}' is no finite number")
    return value


def _check_strings(content: object) -> None:
    if isinstance(content, dict):
        content = [*content, *content.values()]
    if isinstance(content, list):
        for one in content:
            _check_strings(one)
    elif isinstance(content, str) and not content.isprintable():
        raise ValueError(f"{content!r} has characters that cannot be shown")
