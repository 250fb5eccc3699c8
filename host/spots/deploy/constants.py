"""Replaces names of integer constants by their values, in a copy of the firmware's package.

On a board, the name of a constant takes 10 to 30 bytes of flash and heap in each module that uses
it, and each look-up takes 2 us. MicroPython's own ``const`` works in one module only. The
function ``const`` and its imports are removed: the compilers of MicroPython and CircuitPython
evaluate ``const(...)`` without them.
"""

from __future__ import annotations

import ast
import re
from collections import Counter
from pathlib import Path

from .source import Source

_NAME = re.compile(r"[A-Z][A-Z0-9_]*")


def inline(package: Path) -> None:
    """Replace public integer constants by their values; remove their definitions and imports.

    A constant has a name in capitals, and only one assignment in its module. Its value is computed
    from numbers and other constants. Names that a module uses as an attribute (``module.NAME``) are
    not changed, nor are the constants of the package's module ``__init__``.

    Parameters
    ----------
    package : Path
        Folder of the package; its modules are changed in place.
    """
    modules = {
        path.relative_to(package).with_suffix("").as_posix(): _Module(path)
        for path in sorted(package.rglob("*.py"))
    }
    attributes = {name for module in modules.values() for name in module.attributes}
    found = -1
    while found != sum(len(module.values) for module in modules.values()):
        found = sum(len(module.values) for module in modules.values())
        for name, module in modules.items():
            module.evaluate(name, modules, attributes)
    for module in modules.values():
        module.replace_names()


class _Module(Source):
    """A module of the firmware, with the values of the constants that it defines or imports."""

    def __init__(self, path: Path):
        super().__init__(path)
        self.values: dict[str, int] = {}
        nodes = list(ast.walk(self.tree))  # a single walk, as it takes most of the time of a build
        self.attributes = {node.attr for node in nodes if isinstance(node, ast.Attribute)}
        self._names = [node for node in nodes if isinstance(node, ast.Name)]
        self._imports = [node for node in nodes if isinstance(node, ast.ImportFrom) and node.level]
        stored = Counter(node.id for node in self._names if isinstance(node.ctx, ast.Store))
        self._once = {name for name, times in stored.items() if times == 1}
        self._removed: dict[ast.stmt, str] = {}
        for node in self.tree.body:
            if isinstance(node, ast.FunctionDef) and node.name == "const":
                self._removed[node] = "pass"
            elif isinstance(node, ast.ImportFrom):
                self._import(node, {})

    def evaluate(self, name: str, modules: dict[str, _Module], kept: set[str]) -> None:
        """Find the values of the constants that the module defines or imports.

        `name` is the module's path in the package. `modules` contains all modules of the package,
        by their paths. `kept` contains the names that must not be replaced by values.
        """
        for node in self._imports:
            folder = name.split("/")[: -node.level]
            origin = modules.get("/".join([*folder, *(node.module or "").split(".")]))
            if origin is not None:
                self._import(node, origin.values)
        if name == "__init__":  # other programs use the constants of this module
            return
        for node in self.tree.body:
            if not isinstance(node, ast.Assign):
                continue
            names = {
                one.id
                for target in node.targets
                for one in ast.walk(target)
                if isinstance(one, ast.Name)
            }
            if not all(map(_NAME.fullmatch, names)) or not names <= self._once - kept:
                continue
            found = {}
            code = compile(ast.Module([node], []), "", "exec")
            try:
                exec(code, {"__builtins__": {"range": range}, **self.values}, found)
            except (NameError, TypeError):
                continue
            if found.keys() == names and all(type(one) is int for one in found.values()):
                self.values |= found
                self._removed[node] = "pass"

    def _import(self, node: ast.ImportFrom, values: dict[str, int]) -> None:
        left = [alias for alias in node.names if alias.name not in values and alias.name != "const"]
        for alias in node.names:
            if alias.name in values:
                self.values[alias.asname or alias.name] = values[alias.name]
        if len(left) < len(node.names):
            self._removed[node] = (
                ast.unparse(ast.ImportFrom(node.module, left, node.level)) if left else "pass"
            )

    def replace_names(self) -> None:
        """Write the module's file again, with values in place of the names of constants."""
        inside = {child for node in self._removed for child in ast.walk(node)}
        values = {
            node: f"({self.values[node.id]})"
            for node in self._names
            if node.id in self.values and node not in inside
        }
        for node, text in (self._removed | values).items():
            self.replace(
                (node.lineno, node.col_offset), (node.end_lineno, node.end_col_offset), text
            )
        self.write()
