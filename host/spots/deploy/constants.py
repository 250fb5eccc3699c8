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
from collections.abc import Mapping
from pathlib import Path
from types import SimpleNamespace

from ..errors import FileError
from .source import Source

_NAME = re.compile(r"_?[A-Z][A-Z0-9_]*")
_FUNCTIONS = {"range": range, "const": lambda value: value}  # usable in the value of a constant
_POINTERS = ("ptr8", "ptr16", "ptr32")  # viper's casts of an object to the address of its data


def inline(package: Path, given: Mapping[str, int] | None = None) -> None:
    """Replace integer constants by their values; remove their definitions and imports.

    A constant has a name in capitals, and only one assignment in its module. Its value is computed
    from numbers and other constants. A module may import a constant by its name, or its module:
    ``from . import state as c`` and ``c.X_UM``. A name that is an attribute of anything else than a
    module of the package is not changed, nor are the constants of the package's module
    ``__init__``. `given` has other values for constants, by their names. ``x ^ C`` and ``x - C``
    become ``x`` if C is 0.

    The modules of the package are changed in place. SpotsError if a function in machine code looks
    up a name in capitals that is no constant.
    """
    modules = {
        path.relative_to(package).with_suffix("").as_posix(): _Module(path)
        for path in sorted(package.rglob("*.py"))
    }
    for name, module in modules.items():
        module.resolve(name, modules)
    attributes = set().union(*(module.attributes() for module in modules.values()))
    found = -1
    while found != sum(len(module.values) for module in modules.values()):
        found = sum(len(module.values) for module in modules.values())
        for name, module in modules.items():
            module.evaluate(name, modules, attributes, given or {})
    for name, module in modules.items():
        module.replace_names(name)


class _Module(Source):
    """A module of the firmware, with the values of the constants that it defines or imports."""

    def __init__(self, path: Path):
        super().__init__(path)
        self.values: dict[str, int] = {}
        nodes = list(ast.walk(self.tree))  # a single walk, as it takes most of the time of a build
        self._attributes = [node for node in nodes if isinstance(node, ast.Attribute)]
        self._names = [node for node in nodes if isinstance(node, ast.Name)]
        self._operations = [node for node in nodes if isinstance(node, ast.BinOp)]
        self._imports = [node for node in nodes if isinstance(node, ast.ImportFrom) and node.level]
        stored = Counter(node.id for node in self._names if isinstance(node.ctx, ast.Store))
        self._once = {name for name, times in stored.items() if times == 1}
        self._bound = {*stored, *(node.arg for node in nodes if isinstance(node, ast.arg))}
        self._modules: dict[str, _Module] = {}
        self._removed: dict[ast.stmt, str] = {}
        for node in self.tree.body:
            if isinstance(node, ast.FunctionDef) and node.name == "const":
                self._removed[node] = "pass"

    def resolve(self, name: str, modules: dict[str, _Module]) -> None:
        """Find the modules of the package that this module imports, by their local names.

        `name` is this module's path in the package. `modules` contains all modules of the package,
        by their paths.
        """
        for node in self._imports:
            for alias in node.names:
                local = alias.asname or alias.name
                origin = modules.get("/".join([*_origin(node, name), alias.name]))
                if origin is not None and local not in self._bound:
                    self._modules[local] = origin

    def attributes(self) -> set[str]:
        """Return the names of all attributes, except those of modules of the package."""
        return {node.attr for node in self._attributes if self._module_of(node) is None}

    def _module_of(self, node: ast.Attribute) -> _Module | None:
        is_name = isinstance(node.value, ast.Name)
        return self._modules.get(node.value.id) if is_name else None

    def evaluate(
        self, name: str, modules: dict[str, _Module], kept: set[str], given: Mapping[str, int]
    ) -> None:
        """Find the values of the constants that the module defines or imports.

        `name` and `modules` are as in `resolve`, `given` is as in `inline`. `kept` contains the
        names that must not be replaced by values.
        """
        for node in self._imports:
            origin = modules.get("/".join(_origin(node, name)))
            if origin is not None:
                for alias in node.names:
                    if alias.name in origin.values:
                        self.values[alias.asname or alias.name] = origin.values[alias.name]
        if name == "__init__":  # other programs use the constants of this module
            return
        known = {local: SimpleNamespace(**of.values) for local, of in self._modules.items()}
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
                exec(code, {"__builtins__": _FUNCTIONS, **known, **self.values}, found)
            except (AttributeError, NameError, TypeError):
                continue
            if found.keys() == names and all(type(one) is int for one in found.values()):
                self.values |= {one: given.get(one, value) for one, value in found.items()}
                self._removed[node] = "pass"

    def replace_names(self, name: str) -> None:
        """Write the module's file again, with values in place of the names of constants."""
        used = {
            node: of.values[node.attr]
            for node in self._attributes
            if (of := self._module_of(node)) is not None and node.attr in of.values
        }
        replaced = {node.value for node in used}
        left = {node.id for node in self._names if node not in replaced}
        for node in self._imports:
            self._remove_import(node, left)
        inside = {child for node in self._removed for child in ast.walk(node)}
        used |= {node: self.values[node.id] for node in self._names if node.id in self.values}
        values = {node: f"({value})" for node, value in used.items() if node not in inside}
        self._check_machine_code(name, {*values, *replaced})
        for node in self._operations:
            if values.get(node.right) == "(0)" and isinstance(node.op, (ast.BitXor, ast.Sub)):
                del values[node.right]
                self.omit_right(node)
        for node, text in (self._removed | values).items():
            self.replace(
                (node.lineno, node.col_offset), (node.end_lineno, node.end_col_offset), text
            )
        self.write()

    def _remove_import(self, node: ast.ImportFrom, left: set[str]) -> None:
        """Remove the names of constants from an import, and modules of which nothing is `left`."""
        kept = []
        for alias in node.names:
            local = alias.asname or alias.name
            is_constant = local in self.values or alias.name == "const"
            if not (is_constant or (local in self._modules and local not in left)):
                kept.append(alias)
        if len(kept) < len(node.names):
            self._removed[node] = (
                ast.unparse(ast.ImportFrom(node.module, kept, node.level)) if kept else "pass"
            )

    def _check_machine_code(self, name: str, replaced: set[ast.expr]) -> None:
        """Refuse a function in machine code that would look up a name at run time."""
        for function in self.tree.body:
            if "micropython.viper" not in map(ast.unparse, getattr(function, "decorator_list", ())):
                continue
            nodes = list(ast.walk(function))
            data = {
                node.args[0]
                for node in nodes
                if isinstance(node, ast.Call) and getattr(node.func, "id", "") in _POINTERS
            }
            for node in nodes:
                looked_up = getattr(node, "attr", "") or getattr(node, "id", "")
                is_constant = _NAME.fullmatch(looked_up)
                if is_constant and node not in replaced | data:
                    raise FileError(
                        f"{name}.py, line {node.lineno}: {function.name} looks {looked_up} up in "
                        "machine code: make it a constant of a module",
                        f"{name}.py",
                        f"line {node.lineno}",
                    )


def _origin(node: ast.ImportFrom, name: str) -> list[str]:
    """Return the path of the folder or module from which the module `name` imports."""
    return [*name.split("/")[: -node.level], *filter(None, (node.module or "").split("."))]
