"""Stores calibrations of simulated strips in a folder, so that other processes can reuse them.

`kept_folder` describes the folder.
"""

from __future__ import annotations

import os
from collections.abc import Callable
from functools import lru_cache, wraps
from hashlib import sha256
from pathlib import Path
from typing import TypeVar

import msgspec

from spots.common.atomic import begins, replacing

from ..board.kept_folder import FOLDER
from ..board.runtimes import is_cpython

_IN_MEMORY = 16
_KIND = begins("a stored result", b"{", b"[")

T = TypeVar("T")


def kept(kind: type[T]) -> Callable[[Callable[..., T]], Callable[..., T]]:
    """Return a decorator that caches a function's results in memory, and as files in a folder.

    The environment variable SPOTS_CALIBRATIONS names the folder; without it, no file is written.
    msgspec must be able to encode the results (of type `kind`) and the arguments.
    """

    def decorator(make: Callable[..., T]) -> Callable[..., T]:
        @lru_cache(_IN_MEMORY)
        @wraps(make)
        def cached(*arguments) -> T:
            if not os.environ.get(FOLDER):
                return make(*arguments)
            # Each runtime has its own entry, because tests compare MicroPython and CPython.
            key = msgspec.json.encode([make.__name__, is_cpython(), arguments])
            path = Path(os.environ[FOLDER]) / f"{sha256(key).hexdigest()}.json"
            if path.exists():
                return msgspec.json.decode(path.read_bytes(), type=kind)
            made = make(*arguments)
            with replacing(path, _KIND) as file:
                file.write(msgspec.json.encode(made))
            return made

        return cached

    return decorator
