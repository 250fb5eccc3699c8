"""Converts the content of a TOML file to a struct, and names the first invalid key of the file.

msgspec decides whether the content is valid. If not, the content is compared with the types of the
struct, so that the message has the words of the file and the path of the key.
"""

import operator
from collections.abc import Iterable, Sequence
from datetime import date, datetime, time
from itertools import count, groupby, repeat
from typing import Any, NoReturn, TypeVar

import msgspec
from msgspec import inspect

from ..errors import did_you_mean

_Kind = TypeVar("_Kind")
# What a value of TOML is called in messages, and which values fit to a type of msgspec.
_WORDS: dict[type, str] = {
    bool: "true or false",
    int: "a whole number",
    float: "a decimal number",  # 1.0 is no whole number
    str: "text",
    list: "a list",
    dict: "a table",
    datetime: "a date with a time",
    date: "a date",
    time: "a time",
}
_FITTING: dict[type, tuple[type, ...]] = {
    inspect.BoolType: (bool,),
    inspect.IntType: (int,),
    inspect.FloatType: (float, int),
    inspect.StrType: (str,),
    inspect.DateTimeType: (datetime,),
    inspect.ListType: (list, tuple),
    inspect.VarTupleType: (list, tuple),
    inspect.TupleType: (list, tuple),
    inspect.DictType: (dict,),
    inspect.StructType: (dict,),
    inspect.NoneType: (type(None),),
}
_LIMITS = {"ge": "at least", "gt": "more than", "le": "at most", "lt": "less than"}


class WrongTomlError(msgspec.ValidationError):
    """Raised if a TOML file is invalid.

    `place` is a line such as "line 3", or a key such as "layer.key.tap"; empty if it is unknown, or
    if the whole file is meant.
    """

    def __init__(self, text: str, place: str = ""):
        super().__init__(text)
        self.place = place


class WrongKeyError(WrongTomlError):
    """Raised if a key of a file is unknown or missing, or if its value is invalid.

    `keys` has the tables that contain the key, outermost first, and the key.
    """

    def __init__(self, text: str, path: Sequence[str | int]):
        self.keys = [step for step in path if isinstance(step, str)]
        super().__init__(text, ".".join(self.keys))


def convert(content: dict, kind: type[_Kind]) -> _Kind:
    """Convert the parsed content of a TOML file to a struct of type `kind`.

    WrongKeyError if a key is unknown or missing, or a value is invalid. For an unknown key the text
    suggests keys that exist.
    """
    try:
        return msgspec.convert(content, kind)
    except msgspec.ValidationError:
        _check(content, inspect.type_info(kind), ())
        raise


def _check(value: Any, kind: inspect.Type, path: tuple) -> None:
    """Raise the error for the first fault of a value, in the order of the file; else return."""
    kinds = list(getattr(kind, "types", [kind]))
    fitting = [one for one in kinds if _fits(value, one)]
    if not fitting:
        allowed = " or ".join(dict.fromkeys(filter(None, map(_name, kinds))))
        _refuse(path, f"must be {allowed}, not {_WORDS.get(type(value), 'nothing')}")
    kind = fitting[0]
    if isinstance(kind, inspect.StructType):
        _check_table(value, fitting, path)
    elif isinstance(kind, inspect.LiteralType):
        _check_choice(value, kind, path)
    else:
        _check_limits(value, kind, path)
    for step, inner, of in _entries(value, kind):
        _check(inner, of, (*path, step))


def _entries(value: Any, kind: inspect.Type) -> Iterable[tuple[str | int, Any, inspect.Type]]:
    """Yield key or index, value and type of each entry of a list, or of a table with free names."""
    if isinstance(kind, inspect.DictType):
        return zip(value.keys(), value.values(), repeat(kind.value_type))
    if isinstance(kind, inspect.TupleType):
        return zip(count(), value, kind.item_types)
    if isinstance(kind, (inspect.ListType, inspect.VarTupleType)):
        return zip(count(), value, repeat(kind.item_type))
    return ()


def _check_table(value: dict, kinds: list, path: tuple) -> None:
    """Check the keys of a struct, or of that one of several structs which the tag names."""
    tag = kinds[0].tag_field
    struct, known = kinds[0], [tag] if tag else []
    if tag:
        if tag not in value:
            raise _missing(tag, path)
        _check(value[tag], inspect.LiteralType(tuple(one.tag for one in kinds)), (*path, tag))
        struct = next(one for one in kinds if one.tag == value[tag])
    fields = {one.encode_name: one for one in struct.fields}
    for key, inner in value.items():
        if key in fields:
            _check(inner, fields[key].type, (*path, key))
        elif key not in known:
            hint = did_you_mean(key, [*known, *fields])
            raise WrongKeyError(f"unknown key '{key}'{_inside(path)}: {hint}", (*path, key))
    for key, field in fields.items():
        if field.required and key not in value:
            raise _missing(key, path)
    try:
        msgspec.convert(value, struct.cls)
    except msgspec.ValidationError as error:
        # The cause is the struct's own ValueError, about keys that do not fit together.
        place = f" ({_place(path)})" if path else ""
        raise WrongKeyError(f"{error.__cause__ or error}{place}", path) from None


def _check_choice(value: Any, kind: inspect.LiteralType, path: tuple) -> None:
    if value in kind.values:
        return
    if isinstance(value, str):
        hint = did_you_mean(value, map(str, kind.values))
        raise WrongKeyError(f"{_place(path)} cannot be '{value}': {hint}", path)
    _refuse(path, f"must be {' or '.join(map(str, kind.values))}, not {value}")


def _check_limits(value: Any, kind: inspect.Type, path: tuple) -> None:
    """Check the range of a number, or the length of a text or list."""
    for limit, words in _LIMITS.items():
        bound = getattr(kind, limit, None)
        if bound is not None and not getattr(operator, limit)(value, bound):
            _refuse(path, f"must be {_name(kind)} of {words} {bound}")
    least, most = getattr(kind, "min_length", None), getattr(kind, "max_length", None)
    if isinstance(kind, inspect.TupleType):
        least = most = len(kind.item_types)
    below, above = least is not None and len(value) < least, most is not None and len(value) > most
    if below or above:
        words = "" if least == most else "at least " if below else "at most "
        bound = least if below else most
        one, more = ("character", "characters") if isinstance(value, str) else ("entry", "entries")
        unit = one if bound == 1 else more
        _refuse(path, f"must be {_name(kind)} of {words}{bound} {unit}, not {len(value)}")


def _fits(value: Any, kind: inspect.Type) -> bool:
    if isinstance(kind, inspect.AnyType):
        return True
    if isinstance(kind, inspect.LiteralType):
        return type(value) in map(type, kind.values)
    if isinstance(kind, inspect.DateTimeType) and isinstance(value, str):
        try:
            return bool(msgspec.convert(value, datetime))
        except msgspec.ValidationError:
            return False
    return type(value) in _FITTING[type(kind)]  # a bool is also an int, so not by isinstance


def _name(kind: inspect.Type) -> str:
    """Return the words for a type; empty for the absence of a value, which TOML cannot express."""
    if isinstance(kind, inspect.NoneType):
        return ""
    if isinstance(kind, inspect.FloatType):
        return "a number"
    own = kind.values[0] if isinstance(kind, inspect.LiteralType) else None
    return _WORDS[type(own) if own is not None else _FITTING[type(kind)][0]]


def _refuse(path: tuple, reason: str) -> NoReturn:
    raise WrongKeyError(f"{_place(path) or 'the file'} {reason}", path)


def _missing(key: str, path: tuple) -> WrongKeyError:
    return WrongKeyError(f"the key '{key}' is missing{_inside(path)}: add it", (*path, key))


def _inside(path: tuple) -> str:
    place = _place(path)
    table = "" if " of " in place else "table "
    return f" in {table}{place}" if place else ""


def _place(path: tuple) -> str:
    """Return a path in words: ``("leak", 0, 1)`` is ``entry 2 of entry 1 of leak``."""
    place = ""
    for is_name, steps in groupby(path, lambda step: isinstance(step, str)):
        if is_name:
            names = ".".join(steps)
            place = f"{names} in {place}" if place else names
        else:
            for index in steps:
                place = f"entry {index + 1} of {place}"
    return place
