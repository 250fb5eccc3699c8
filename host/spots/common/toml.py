"""Reads TOML files and validates their keys, and writes TOML; size and depth are limited."""

import json
import math
import re
import sys
from collections.abc import Mapping
from datetime import datetime
from pathlib import Path
from typing import TypeVar

import msgspec

from ..errors import FileError, path_text
from . import kinds
from .bounded import read_text
from .schema import WrongTomlError, convert

if sys.version_info >= (3, 11):
    import tomllib
else:
    import tomli as tomllib

_Kind = TypeVar("_Kind")
# TOML keys of texts to type. These may have characters that are keys, although not printable.
_TYPED = ("text", "macro")
_KEYS_OF_TEXT = dict.fromkeys(map(ord, "\n\t\u00a0\u00ad\u202f"))
_TOO_DEEP = "tables or lists are nested too deep: write fewer levels"
# Largest number of parts of a dotted key. The reader's time grows with the square of this number.
_KEY_PARTS_MAX = 32
# Separators of keys, in a file without its strings and comments.
_BETWEEN_KEYS = re.compile(r"[=,\[\]{}\n]")
_TWICE = re.compile(r"Cannot declare \('(\w+)',\) twice")
# A float has at most 308 digits before its point.
_TOO_LONG = re.compile(r"(?<![\w.])(?:\d_?){309}")
# The key before the end of a text.
_KEY_BEFORE = re.compile(r"([\w.-]+)\s*=[^=]*\Z")
# The first characters of a match decide its alternative, so the time is linear in the text.
STRING_OR_COMMENT = re.compile(
    r'"""(?:[^\\]|\\.)*?(?:"{3,5}|\Z)'
    r"|'''.*?(?:'{3,5}|\Z)"
    r'|"(?:[^"\\\n]|\\.)*"?'
    r"|'[^'\n]*'?"
    r"|#[^\n]*",
    re.DOTALL,
)


class Strict(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """Base class of the tables in a TOML file; unknown keys are errors."""


def find(name: str | Path, folder: Path, what: str) -> tuple[Path, str]:
    """Return path and text of a TOML file that belongs to the user or to the package.

    `name` is a path that ends in ``.toml``, or the name of a file in `folder` without its suffix.
    `what` names the kind of file in messages, such as "layout". FileError if the file cannot be
    read as text, is not a regular file, or is too large.
    """
    name = path_text(name, f"the name of a {what} file")
    path, packaged = Path(name), folder / f"{name}.toml"
    # A name without a suffix may also be the path of a folder or of a file of another kind.
    if not path.suffix and (packaged.exists() or not path.exists()):
        path = packaged
    try:
        return path, read_text(path)
    except FileNotFoundError:
        known = ", ".join(sorted(file.stem for file in folder.glob("*.toml")))
        raise FileError(
            f"cannot read the {what} file {name}, because there is no such file: give the path of "
            f"a file that ends in .toml, or one of these names: {known}",
            name,
        ) from None
    except (OSError, UnicodeDecodeError) as error:
        raise kinds.not_read(name, error, f"a {what} file") from None


def loads(text: str) -> dict:
    """Return the content of a TOML file.

    msgspec.ValidationError if the text is not TOML, is nested too deep, or has a number that is not
    finite or a string with unprintable characters.
    """
    plain = STRING_OR_COMMENT.sub(lambda match: re.sub(r"[^\n]", " ", match[0]), text)
    try:
        _check_plain(plain)
        content = tomllib.loads(text, parse_float=finite)
        _check_strings(content)
    except RecursionError:
        raise msgspec.ValidationError(_TOO_DEEP) from None
    except NotFiniteError as error:
        found = re.search(rf"(?<![\w.]){re.escape(error.text)}(?!\w)", plain)
        raise _wrong_number(plain, found, str(error)) from None
    except tomllib.TOMLDecodeError as error:
        line = getattr(error, "lineno", None)  # from Python 3.14 on
        remedy = "correct this place, or restore the rest of the file"
        if table := _TWICE.search(str(error)):
            remedy = f"remove one, or write [[{table[1]}]] with two brackets if there are several"
        raise WrongTomlError(
            f"wrong TOML syntax: {error}; {remedy}",
            f"line {line}" if line else "",
        ) from None
    return content


def _check_plain(plain: str) -> None:
    """Check what would make the parser slow, in a text whose strings and comments are blank."""
    if any(part.count(".") >= _KEY_PARTS_MAX for part in _BETWEEN_KEYS.split(plain)):
        raise msgspec.ValidationError(_TOO_DEEP)
    if found := _TOO_LONG.search(plain):
        raise _wrong_number(plain, found, "a number has too many digits")


def _wrong_number(plain: str, found: re.Match[str] | None, reason: str) -> WrongTomlError:
    """Return the error for an invalid number, with its line and its key if it was found."""
    if found is None:
        return WrongTomlError(f"{reason}; write a number")
    before = plain[: found.start()]
    key = _KEY_BEFORE.search(before)
    line = f"line {before.count(chr(10)) + 1}"
    return WrongTomlError(f"{line}{f' ({key[1]})' if key else ''}: {reason}; write a number", line)


class NotFiniteError(ValueError):
    """Raised for a number that is not finite, or is too large for a float."""

    def __init__(self, text: str):
        super().__init__(f"'{text}' is not a finite number")
        self.text = text


def finite(text: str) -> float:
    """Return the number in a text; raise NotFiniteError if it is not finite."""
    value = float(text)
    if not math.isfinite(value):
        raise NotFiniteError(text)
    return value


def _check_strings(content: object, is_typed: bool = False) -> None:
    if isinstance(content, dict):
        for key, value in content.items():
            _check_strings(key)
            _check_strings(value, is_typed or key in _TYPED)
    elif isinstance(content, list):
        for one in content:
            _check_strings(one, is_typed)
    elif (
        isinstance(content, str)
        and not (content.translate(_KEYS_OF_TEXT) if is_typed else content).isprintable()
    ):
        raise msgspec.ValidationError(f"{content!r} has unprintable characters: remove them")


def comments(text: str) -> list[str]:
    """Return the comments in the text of a TOML file, each with its ``#``."""
    found = (match[0].rstrip() for match in STRING_OR_COMMENT.finditer(text))
    return [one for one in found if one.startswith("#")]


def dumps(content: dict, prefix: str = "", comments: Mapping[str, str] = {}) -> str:
    """Return a dict as TOML, without the keys whose value is None.

    The values are numbers, strings, lists of these, dates, dicts, and lists of dicts; the keys are
    bare keys. `prefix` is the name of the table that has this content, with a dot at its end; empty
    for a file. `comments` are written above some keys, each with its ``#``. The last line has no
    newline.
    """
    lines, tables = [], []
    for key, value in content.items():
        comment = [comments[key]] if key in comments else []
        if isinstance(value, dict):
            tables += ["", *comment, f"[{prefix}{key}]", dumps(value, f"{prefix}{key}.")]
        elif isinstance(value, list) and value and isinstance(value[0], dict):
            for one in value:
                tables += ["", f"[[{prefix}{key}]]", dumps(one, f"{prefix}{key}.")]
        elif isinstance(value, datetime):
            lines += [*comment, f"{key} = {value.isoformat().replace('+00:00', 'Z')}"]
        elif value is not None:
            # JSON's numbers, strings and lists are also TOML, except for escaped surrogate pairs,
            # which `ensure_ascii=False` avoids.
            lines += [*comment, f"{key} = {json.dumps(value, ensure_ascii=False)}"]
    return "\n".join(lines + tables)


def checked(text: str, kind: type[_Kind], what: str, path: str | Path) -> _Kind:
    """Parse and validate a TOML file; return its content as a struct of type `kind`.

    `what` names the kind of file in messages, such as "layout". FileError if the text is not TOML,
    a key is unknown or missing, or a value is invalid.
    """
    try:
        return convert(loads(text), kind)
    except msgspec.ValidationError as error:
        kinds.check(path, text, f"a {what} file")
        raise FileError(f"{what} file {path}: {error}", path, getattr(error, "place", "")) from None
