"""The standard library's TOML reader, or its forerunner on Python 3.10; files of checked keys."""

from __future__ import annotations

import math
import sys
from typing import TypeVar

import msgspec

from .errors import SpotsError

if sys.version_info >= (3, 11):
    from tomllib import TOMLDecodeError, loads
else:
    from tomli import TOMLDecodeError, loads

__all__ = ["TOMLDecodeError", "checked", "loads"]

_Kind = TypeVar("_Kind")


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
        return msgspec.convert(loads(text, parse_float=_finite), kind)
    except (TOMLDecodeError, msgspec.ValidationError) as error:
        raise SpotsError(f"{what}: {error}") from None


def _finite(text: str) -> float:
    value = float(text)
    if not math.isfinite(value):
        raise msgspec.ValidationError(f"'{text}' is no finite number")
    return value
