"""TOML files of checked keys, bounded in size and depth, by the standard library's reader."""

from __future__ import annotations

import math
import re
import sys
from pathlib import Path
from typing import TypeVar

import msgspec
from msgspec import inspect

from .bounded import read_text
from .errors import SpotsError, did_you_mean

if sys.version_info >= (3, 11):
    import tomllib
else:
    import tomli as tomllib

_Kind = TypeVar("_Kind")
_TOO_DEEP = "tables or lists are nested too deep"
# The reader takes time that grows with the square of a key's parts.
_KEY_PARTS_MAX = 32
# Dots of a key stand between these; texts and comments are taken away before.
_BETWEEN_KEYS = re.compile(r"[=,\[\]{}\n]")
# Each alternative matches from its first character on, so that the time is linear in any text.
_TEXT_OR_COMMENT = re.compile(
    r'"""(?:[^\\]|\\.)*?(?:"{3,5}|\Z)'
    r"|'''.*?(?:'{3,5}|\Z)"
    r'|"(?:[^"\\\n]|\\.)*"?'
    r"|'[^'\n]*'?"
    r"|#[^\n]*",
    re.DOTALL,
)

# How msgspec reports a key or a value that does not exist, and the parts of its path there.
_UNKNOWN = re.compile(r"(?:unknown field `|Invalid enum value ')(.*?)[`'](?: - at `\$(.*)`)?$")
_STEP = re.compile(r"\.([^.\[]+)|\[[^]]*\]")


def find(name: str | Path, folder: Path, what: str) -> tuple[Path, str]:
    """Return path and text of a file, by its path or by the name of one in the folder.

    Parameters
    ----------
    name : str or Path
        A path that ends in ``.toml``, or the name of a file in `folder`.
    folder : Path
        With the files that come with the package.
    what : str
        Kind of file, for the message.

    Returns
    -------
    path : Path
    text : str

    Raises
    ------
    SpotsError
        If there is no such file, and the text says which names exist; or it is not a regular file,
        or too large.
    """
    path = Path(name)
    if not path.suffix:
        path = folder / f"{name}.toml"
    try:
        return path, read_text(path)
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
        _check_keys(text)
        content = tomllib.loads(text, parse_float=_finite)
        _check_strings(content)
    except RecursionError:
        raise msgspec.ValidationError(_TOO_DEEP) from None
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

    Returns
    -------
    msgspec.Struct
        Of type `kind`.

    Raises
    ------
    SpotsError
        If it is not TOML, or a key in it is unknown, missing or out of range.
    """
    try:
        return convert(loads(text), kind)
    except msgspec.ValidationError as error:
        raise SpotsError(f"{what}: {error}") from None


def convert(content: dict, kind: type[_Kind]) -> _Kind:
    """Return a file's content as a `msgspec.Struct`.

    Parameters
    ----------
    content : dict
        As `loads` returns it.
    kind : type
        The struct.

    Returns
    -------
    msgspec.Struct
        Of type `kind`.

    Raises
    ------
    msgspec.ValidationError
        If a key is unknown, missing or out of range; the text names the keys that exist.
    """
    try:
        return msgspec.convert(content, kind)
    except msgspec.ValidationError as error:
        wrong = _UNKNOWN.search(str(error))
        if wrong is None:
            raise
        hint = did_you_mean(wrong[1], _known(kind, wrong[2] or ""))
        raise msgspec.ValidationError(f"{error}: {hint}") from None


def _known(kind: type, path: str) -> list[str]:
    """Return the keys, or the values, that a type allows at one of msgspec's paths."""
    found = _alternatives(inspect.type_info(kind))
    for name in _STEP.findall(path):
        found = [one for outer in found for one in _inside(outer, name)]
    names = []
    for one in found:
        if isinstance(one, inspect.StructType):
            names += [one.tag_field] if one.tag_field else []
            names += [field.encode_name for field in one.fields]
        elif isinstance(one, inspect.LiteralType):
            names += map(str, one.values)
    return list(dict.fromkeys(names))


def _inside(outer: inspect.Type, name: str) -> list[inspect.Type]:
    if isinstance(outer, inspect.StructType):
        (inner,) = [field.type for field in outer.fields if field.encode_name == name] or [None]
    else:
        inner = getattr(outer, "item_type", getattr(outer, "value_type", None))
    return _alternatives(inner)


def _alternatives(one: inspect.Type | None) -> list[inspect.Type]:
    return list(getattr(one, "types", [one]))


def _check_keys(text: str) -> None:
    plain = _TEXT_OR_COMMENT.sub("", text)
    if any(part.count(".") >= _KEY_PARTS_MAX for part in _BETWEEN_KEYS.split(plain)):
        raise ValueError(_TOO_DEEP)


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
