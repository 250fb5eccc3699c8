"""Asserts the class of an error, and its code or place, instead of its sentence."""

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import pytest


@contextmanager
def refusal(kind: type[Exception], file: str = "", **reason: object) -> Iterator[Any]:
    """Expect an error of exactly this class and reason, as in ``refusal(BoardError, why="busy")``.

    `file` is the name of the file that is meant, without its folder. Yields pytest's information
    about the exception, as ``pytest.raises`` does.
    """
    with pytest.raises(kind) as caught:
        yield caught
    error: Any = caught.value
    assert type(error) is kind
    assert {name: getattr(error, name) for name in reason} == reason
    assert not file or Path(error.path).name == file
