"""Replaces names of integer constants by their values, in a copy of the firmware's package.

On a board, the name of a constant takes 10 to 30 bytes of flash and heap in each module that uses
it, and each look-up takes 2 us. MicroPython's own ``const`` works in one module only. The
imports of ``const`` are removed: mpy-cross evaluates ``const(...)`` without an import.
"""

from __future__ import annotations

import ast
import re
from collections import Counter
from pathlib import Path

_NAME = re.compile(r"[A-Z][A-Z0-9_]*")
_CONST = "from micropython import const"


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
        module.write()


class _Module:
    """A module of the firmware, with the values of the constants that it defines or imports."""

    def __init__(self, path: Path):
        self._path = path
        self._text = path.read_bytes()
        self._tree = ast.parse(self._text)
        self.values: dict[str, int] = {}  # constants that are defined here
        self.attributes: set[str] = set()
        self._imported: dict[str, int] = {}
        self._removed: dict[ast.stmt, str] = {}
        self._names: list[ast.Name] = []
        self._imports: list[ast.ImportFrom] = []
        for node in ast.walk(self._tree):  # a single walk, as it takes most of the time of a build
            if isinstance(node, ast.Name):
                self._names.append(node)
            elif isinstance(node, ast.Attribute):
                self.attributes.add(node.attr)
            elif isinstance(node, ast.ImportFrom) and node.level:
                self._imports.append(node)
        stored = Counter(node.id for node in self._names if isinstance(node.ctx, ast.Store))
        self._once = {name for name, times in stored.items() if times == 1}
        self._remove_const()

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
        known = self._imported | self.values
        for node in self._tree.body:
            if not isinstance(node, ast.Assign) or len(node.targets) != 1:
                continue
            target = node.targets[0]
            targets = target.elts if isinstance(target, ast.Tuple) else [target]
            names = [one.id for one in targets if isinstance(one, ast.Name)]
            if len(names) != len(targets) or not all(map(_NAME.fullmatch, names)):
                continue
            if not self._once.issuperset(names) or kept.intersection(names):
                continue
            expression = compile(ast.Expression(node.value), "", "eval")
            try:
                value = eval(expression, {"__builtins__": {"range": range}}, known)
                values = list(value) if isinstance(target, ast.Tuple) else [value]
            except (NameError, TypeError):
                continue
            if len(values) == len(names) and all(type(one) is int for one in values):
                self.values.update(zip(names, values))
                known = self._imported | self.values
                self._removed[node] = "pass"

    def _import(self, node: ast.ImportFrom, values: dict[str, int]) -> None:
        left = [alias for alias in node.names if alias.name not in values and alias.name != "const"]
        for alias in node.names:
            if alias.name in values:
                self._imported[alias.asname or alias.name] = values[alias.name]
        if len(left) < len(node.names):
            self._removed[node] = (
                ast.unparse(ast.ImportFrom(node.module, left, node.level)) if left else "pass"
            )

    def _remove_const(self) -> None:
        for node in self._tree.body:
            if isinstance(node, ast.Try) and ast.unparse(node.body) == _CONST:
                self._removed[node] = "pass"
            elif isinstance(node, ast.ImportFrom):
                self._import(node, {})

    def write(self) -> None:
        """Write the module's file again, with values in place of the names of constants."""
        known = self._imported | self.values
        lines = self._text.splitlines(keepends=True)
        starts = [0]
        for line in lines:
            starts.append(starts[-1] + len(line))
        inside = {child for node in self._removed for child in ast.walk(node)}
        replaced = dict(self._removed) | {
            node: f"({known[node.id]})"
            for node in self._names
            if node.id in known and node not in inside
        }
        changes = []
        for node, text in replaced.items():
            first = starts[node.lineno - 1] + node.col_offset
            changes.append((first, starts[node.end_lineno - 1] + node.end_col_offset, text))
        text = self._text
        for first, end, new in sorted(changes, reverse=True):
            text = text[:first] + new.encode() + text[end:]
        self._path.write_bytes(text)
