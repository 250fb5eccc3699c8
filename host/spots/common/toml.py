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
from msgspec import inspect

from ..errors import FileError, did_you_mean, path_text
from . import kinds
from .bounded import read_text

if sys.version_info >= (3, 11):
    import tomllib
else:
    import tomli as tomllib

_Kind = TypeVar("_Kind")
# TOML keys of texts to type. These may have characters that are keys, although not printable.
_TYPED = ("text", "macro")
_KEYS_OF_TEXT = dict.fromkeys(map(ord, "\n\t\u00a0\u00ad\u202f"))
_TOO_DEEP = "tables or lists are nested too deep: write fewer levels"
# The key before the end of a text.
_KEY_BEFORE = re.compile(r"""([\w.-]+)\s*=[^=]*\Z""")
# Largest number of parts of a dotted key. The reader's time grows with the square of this number.
_KEY_PARTS_MAX = 32
# Separators of keys, in a file without its strings and comments.
_BETWEEN_KEYS = re.compile(r"[=,\[\]{}\n]")
# The first characters of a match decide its alternative, so the time is linear in the text.
STRING_OR_COMMENT = re.compile(
    r'"""(?:[^\\]|\\.)*?(?:"{3,5}|\Z)'
    r"|'''.*?(?:'{3,5}|\Z)"
    r'|"(?:[^"\\\n]|\\.)*"?'
    r"|'[^'\n]*'?"
    r"|#[^\n]*",
    re.DOTALL,
)

# Patterns of msgspec's messages about a key, a value or a type, and of the path in these messages.
_KEY = re.compile(r"Object (contains unknown|missing required) field `(.*)`")
_VALUE = re.compile(r"Invalid (?:enum )?value '(.*)'")
_TYPE = re.compile(
    r"Expected `(?P<types>[^`]*)`(?: (?P<sign>[<>]=?) (?P<limit>[^ ,]+))?"
    r"(?: of length (?:(?P<least>[<>]=?) )?(?P<length>\d+))?(?:, got `?(?P<got>[^`]*)`?)?"
)
_AT = re.compile(r"(.*) - at `\$((?:\.\w+|\[(?:[0-9]{1,9}|\.\.\.)\])+)`", re.DOTALL)
_STEP = re.compile(r"\.([^.\[]+)|\[([^]]*)\]")
_PLACE_STEP = re.compile(r"((?:\.[^.\[]+)+)|\[([^]]*)\]")  # several names are one step
# msgspec's names of types and limits, and the words for them in our messages.
_WORDS = {
    "int": "a whole number",
    "float": "a number",
    "str": "text",
    "bool": "true or false",
    "array": "a list",
    "object": "a table",
}
_GOT = _WORDS | {"float": "a decimal number"}  # of the value in a file; 1.0 is no whole number
_LIMITS = {">=": "at least ", "<=": "at most ", ">": "more than ", "<": "less than ", None: ""}


class WrongKeyError(msgspec.ValidationError):
    """Raised if a key of a file is unknown or missing, or if its value is invalid.

    Attributes
    ----------
    keys : list of str
        The key, then the tables that contain it, innermost first.
    """

    def __init__(self, text: str, keys: list[str]):
        super().__init__(text)
        self.keys = keys


class Strict(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """Base class of the tables in a TOML file; unknown keys are errors."""


def find(name: str | Path, folder: Path, what: str) -> tuple[Path, str]:
    """Return path and text of a TOML file that belongs to the user or to the package.

    Parameters
    ----------
    name : str or Path
        Path that ends in ``.toml``, or name of a file in `folder` without its suffix.
    folder : Path
        Folder with the package's files of this kind.
    what : str
        Kind of file for error messages, such as "layout".

    Returns
    -------
    path : Path
        Path of the file.
    text : str
        Text of the file.

    Raises
    ------
    FileError
        If the file cannot be read as text, is not a regular file, or is too large.
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

    Raises
    ------
    msgspec.ValidationError
        If the text is not TOML, is nested too deep, or has a number that is not finite or a
        string with unprintable characters.
    """
    try:
        _check_keys(text)
        content = tomllib.loads(text, parse_float=finite)
        _check_strings(content)
    except RecursionError:
        raise msgspec.ValidationError(_TOO_DEEP) from None
    except tomllib.TOMLDecodeError as error:
        reason = f"wrong TOML syntax: {error}"
        if str(error).endswith("(at end of document)"):
            raise msgspec.ValidationError(f"{reason}; restore the rest of the file") from None
        raise msgspec.ValidationError(f"{reason}; correct this line") from None
    except ValueError as error:
        raise msgspec.ValidationError(_with_line(text, str(error))) from None
    return content


def _with_line(text: str, reason: str) -> str:
    """Return the reason why a value is invalid, with its line in the file and what to do."""
    if "digit" in reason:  # Python's sentence names a function of Python
        reason, wrong = "a number has too many digits", r"\d{1000}"
    elif found := re.match(r"'(.*?)' is not", reason):
        wrong = rf"(?<![\w.]){re.escape(found[1])}(?!\w)"
    else:
        return reason
    plain = STRING_OR_COMMENT.sub(lambda match: re.sub(r"[^\n]", " ", match[0]), text)
    if place := re.search(wrong, plain):
        key = _KEY_BEFORE.search(plain[: place.start()])
        of = f" ({key[1]})" if key else ""
        reason = f"line {text.count(chr(10), 0, place.start()) + 1}{of}: {reason}"
    return f"{reason}; write a number"


def comments(text: str) -> list[str]:
    """Return the comments in the text of a TOML file, each with its ``#``."""
    found = (match[0].rstrip() for match in STRING_OR_COMMENT.finditer(text))
    return [one for one in found if one.startswith("#")]


def dumps(content: dict, prefix: str = "", comments: Mapping[str, str] = {}) -> str:
    """Return a dict as TOML, without the keys whose value is None.

    Parameters
    ----------
    content : dict
        Numbers, strings, lists of these, dates, dicts, and lists of dicts. The keys are bare keys.
    prefix : str
        Name of the table that has this content, with a dot at its end; empty for a file.
    comments : mapping of str to str
        For some keys of `content`, the comment above the value or the table, with its ``#``.

    Returns
    -------
    str
        Lines of TOML, without a newline after the last line.
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
    """Parse and validate a TOML file; return its content as a struct.

    Parameters
    ----------
    text : str
        Text of the file.
    kind : type
        Subclass of `msgspec.Struct` that describes the file.
    what : str
        Kind of the file for error messages, such as "layout".
    path : str or Path
        Path of the file, for error messages.

    Returns
    -------
    msgspec.Struct
        Instance of `kind`.

    Raises
    ------
    FileError
        If the text is not TOML, a key is unknown or missing, or a value is invalid.
    """
    try:
        return convert(loads(text), kind)
    except msgspec.ValidationError as error:
        kinds.check(path, text, f"a {what} file")
        place = ".".join(reversed(getattr(error, "keys", [])))
        raise FileError(f"{what} file {path}: {error}", path, place) from None


def convert(content: dict, kind: type[_Kind]) -> _Kind:
    """Convert the parsed content of a TOML file to a struct.

    Parameters
    ----------
    content : dict
        Content of the file, as `loads` returns it.
    kind : type
        Subclass of `msgspec.Struct` that describes the file.

    Returns
    -------
    msgspec.Struct
        Instance of `kind`.

    Raises
    ------
    WrongKeyError
        If a key is unknown or missing, or a value is invalid. For an unknown key the text suggests
        keys that exist.
    """
    try:
        return msgspec.convert(content, kind)
    except msgspec.ValidationError as error:
        raise _wrong_key(str(error), kind) from None


def _wrong_key(message: str, kind: type) -> WrongKeyError:
    """Return the error for a message of msgspec about content of the type `kind`."""
    found = _AT.fullmatch(message)
    message, path = (found[1], found[2]) if found else (message, "")
    place = _place(path)
    table = "" if " of " in place else "table "
    inside = f" in {table}{place}" if place else ""
    keys = [name for name, _ in reversed(_STEP.findall(path)) if name]
    if wrong := _KEY.fullmatch(message):
        keys.insert(0, wrong[2])
        if wrong[1] == "missing required":
            return WrongKeyError(f"the key '{wrong[2]}' is missing{inside}: add it", keys)
        hint = did_you_mean(wrong[2], _known(kind, path))
        return WrongKeyError(f"unknown key '{wrong[2]}'{inside}: {hint}", keys)
    if wrong := _VALUE.fullmatch(message):
        hint = did_you_mean(wrong[1], _known(kind, path))
        return WrongKeyError(f"{place} cannot be '{wrong[1]}': {hint}", keys)
    if wrong := _TYPE.fullmatch(message):
        return WrongKeyError(f"{place or 'the file'} must be {_allowed(wrong)}", keys)
    return WrongKeyError(f"{message}{f' ({place})' if place else ''}", keys)


def _allowed(wrong: re.Match) -> str:
    types = [_WORDS.get(one, one) for one in wrong["types"].split(" | ") if one != "null"]
    allowed = " or ".join(types)
    if wrong["limit"]:
        allowed += f" of {_LIMITS[wrong['sign']]}{wrong['limit']}"
    if wrong["length"]:
        allowed += f" of {_LIMITS[wrong['least']]}{wrong['length']} entries"
    got = wrong["got"]
    return f"{allowed}, not {_GOT.get(got, got)}" if got else allowed


def _place(path: str) -> str:
    """Return a path of msgspec in words: ``.leak[0][1]`` is ``entry 2 of entry 1 of leak``."""
    place = ""
    for names, index in _PLACE_STEP.findall(path):
        if names:
            place = f"{names[1:]} in {place}" if place else names[1:]
        else:
            number = f"entry {int(index) + 1}" if index != "..." else "an entry"
            place = f"{number} of {place}"
    return place


def _known(kind: type, path: str) -> list[str]:
    """Return the keys or values that the type `kind` allows at a path such as ``.key[0].tap``."""
    found = _alternatives(inspect.type_info(kind))
    for name, _ in _STEP.findall(path):
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
        if name == outer.tag_field:
            return [inspect.LiteralType((outer.tag,))]
        (inner,) = [field.type for field in outer.fields if field.encode_name == name] or [None]
    else:
        inner = getattr(outer, "item_type", getattr(outer, "value_type", None))
    return _alternatives(inner)


def _alternatives(one: inspect.Type | None) -> list[inspect.Type]:
    return list(getattr(one, "types", [one]))


def _check_keys(text: str) -> None:
    plain = STRING_OR_COMMENT.sub("", text)
    if any(part.count(".") >= _KEY_PARTS_MAX for part in _BETWEEN_KEYS.split(plain)):
        raise ValueError(_TOO_DEEP)


def finite(text: str) -> float:
    """Return the number in a text; raise ValueError if it is not a finite number."""
    value = float(text)
    if not math.isfinite(value):
        raise ValueError(f"'{text}' is not a finite number")
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
        raise ValueError(f"{content!r} has unprintable characters: remove them")
