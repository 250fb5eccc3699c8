"""Asserts the class of an error, and its code or place, instead of its sentence."""

from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

import pytest

from spots.errors import SpotsError


@contextmanager
def refusal(kind: type[SpotsError], **reason: str) -> Iterator[Any]:
    """Expect an error of exactly this class and reason, as in ``refusal(BoardError, why="busy")``.

    Yields pytest's information about the exception, as ``pytest.raises`` does.
    """
    with pytest.raises(kind) as caught:
        yield caught
    assert type(caught.value) is kind
    assert {name: getattr(caught.value, name) for name in reason} == reason
