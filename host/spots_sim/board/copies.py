"""Copies of the firmware's package, each with its own modules, for virtual boards in CPython."""

from __future__ import annotations

import functools
import importlib
import itertools
import sys
from importlib.abc import Loader
from importlib.machinery import ModuleSpec, SourceFileLoader
from pathlib import Path
from types import CodeType

import spots_device
from spots.deploy.staging import VIPER

_NAME = "_spots_board_"  # the names of the copies begin like this
# Modules that only MicroPython or CircuitPython can import.
_OTHERS = VIPER, "circuitpython", "micropython"
_numbers = itertools.count()


def load() -> str:
    """Import a new copy of the firmware; return the name of its package."""
    name = f"{_NAME}{next(_numbers)}"
    importlib.import_module(name)
    for part in _parts():
        if part and not (part.startswith("runtime.") or part.endswith(_OTHERS)):
            importlib.import_module(f"{name}.{part}")
    return name


@functools.cache
def _parts() -> dict[str, tuple[str, bool, CodeType | None]]:
    """Return path, whether it is a package, and code of each module, by its name in the firmware.

    They are read one time, because finding and reading all modules takes as long as running them.
    """
    (root,) = map(Path, spots_device.__path__)
    found = {}
    for path in sorted(root.rglob("*.py")):
        words = path.relative_to(root).with_suffix("").parts
        package = words[-1] == "__init__"
        loader = SourceFileLoader(spots_device.__name__, str(path))
        part = ".".join(words[:-1] if package else words)
        found[part] = str(path), package, loader.get_code(spots_device.__name__)
    return found


class _Copies(Loader):
    """Finds and loads the modules of the copies."""

    def find_spec(self, name, path=None, target=None):
        copy, _, part = name.partition(".")
        if not (copy.startswith(_NAME) and part in _parts()):
            return None
        path, package, _ = _parts()[part]
        spec = ModuleSpec(name, self, origin=path, is_package=package)
        spec.has_location = True
        return spec

    def exec_module(self, module):
        exec(_parts()[module.__name__.partition(".")[2]][2], vars(module))


sys.meta_path.append(_Copies())
