"""Shortens identifiers in a copy of the firmware's package, before it is compiled.

An .mpy file stores each identifier that MicroPython could look up at run time. Tracebacks show only
names of modules, classes and functions. So an argument gets the name of an attribute that its file
stores anyway; private data get one or two letters; and private functions and classes keep only as
many first letters as identify them: ``_is_n`` in a traceback is ``_is_next``.
"""

from __future__ import annotations

import ast
import builtins
import re
from collections import Counter
from itertools import chain
from keyword import kwlist
from pathlib import Path
from string import ascii_letters

from .source import Source

_PRIVATE = re.compile(r"_[A-Za-z]\w*")
_START = 3  # least length of a private function's name


def shorten(package: Path) -> None:
    """Replace names of arguments, and private names of data, functions and classes.

    A private name has the same replacement in all modules, because a class may inherit from a class
    of another module. A name stays if the package imports it, uses it as a keyword of a call, or
    has it as a text, for example for ``getattr``.

    Parameters
    ----------
    package : Path
        Folder of the package; its modules are changed in place.
    """
    modules = [_Module(path) for path in sorted(package.rglob("*.py"))]
    keywords = {name for module in modules for name in module.keywords}
    kept = keywords.union(*(one.bound | one.texts | one.functions for one in modules))
    used = kept.union(kwlist, dir(builtins), *(one.names | one.attributes for one in modules))
    counts = Counter(name for module in modules for name in module.private - kept)
    pairs = (a + b for a in ascii_letters for b in ascii_letters if a + b not in used)
    # A letter may be an argument too, so only attributes get one.
    letters = chain((letter for letter in ascii_letters if letter not in used), pairs)
    names = {name for module in modules for name in module.names}
    private = {
        name: next(pairs if name in names else letters)
        for name in sorted(counts, key=lambda name: (-counts[name], name))  # the same in each build
        if len(name) > 2
    }
    functions = {one for module in modules for one in module.functions if _PRIVATE.fullmatch(one)}
    functions -= keywords.union(*(module.bound | module.texts for module in modules))
    for name in functions:
        for end in range(_START, len(name)):
            start = name[:end]
            if start not in used and sum(one.startswith(start) for one in functions) == 1:
                private[name] = start
                break
    for module in modules:
        module.rename(private, keywords)


class _Module(Source):
    def __init__(self, path: Path):
        super().__init__(path)
        self.attributes: set[str] = set()
        self.functions: set[str] = set()  # and classes
        self.bound: set[str] = set()  # by an import or an exception
        self.texts: set[str] = set()
        self.keywords: set[str] = set()  # of calls
        self.names: set[str] = set()  # of variables and arguments
        for node in ast.walk(self.tree):
            match node:
                case ast.Name(id=name) | ast.arg(arg=name):
                    self.names.add(name)
                case ast.Attribute(attr=name):
                    self.attributes.add(name)
                case ast.FunctionDef(name=name) | ast.ClassDef(name=name):
                    self.functions.add(name)
                case ast.alias(asname=str(name)) | ast.alias(name=name):
                    self.bound.add(name)
                case ast.ExceptHandler(name=str(name)):
                    self.bound.add(name)
                case ast.Global(names=names) | ast.Nonlocal(names=names):
                    self.bound.update(names)
                case ast.keyword(arg=str(name)):
                    self.keywords.add(name)
                case ast.Constant(value=str(text)):
                    self.texts.add(text)
                case ast.Assign(targets=targets, value=ast.Call(func=ast.Name(id="const"))):
                    # The compiler removes it.
                    self.bound.update(one.id for one in targets if isinstance(one, ast.Name))
        self.private = set(filter(_PRIVATE.fullmatch, self.names | self.attributes))

    def rename(self, private: dict[str, str], keywords: set[str]) -> None:
        """Write the module's file again with the names in `private`; keep those in `keywords`."""
        self._kept = keywords | self.bound | self.functions
        # The file stores the names of its attributes anyway.
        stored = sorted(private.get(name, name) for name in self.attributes)
        taken = self._kept.union(self.names, map(private.get, self.names), dir(builtins))
        self._free = [name for name in (*stored, *ascii_letters) if name not in taken]
        self._visit(self.tree, private, 0)
        self.write()

    def _visit(self, node: ast.AST, names: dict[str, str], depth: int) -> None:
        """Record the changes in a node; outer functions have `depth` arguments."""
        if isinstance(node, (ast.FunctionDef, ast.ClassDef)) and node.name in names:
            keyword = "class " if isinstance(node, ast.ClassDef) else "def "
            self._replace(node.lineno, node.col_offset + len(keyword), node.name, names)
        if isinstance(node, (ast.FunctionDef, ast.Lambda)):
            arguments = [one for one in node.args.args if one.arg not in self._kept]
            free = self._free[depth:]
            inside = names | {one.arg: new for one, new in zip(arguments, free)}
            for one in arguments:
                self._replace(one.lineno, one.col_offset, one.arg, inside)
            for one in (*node.args.defaults, *getattr(node, "decorator_list", ())):
                self._visit(one, names, depth)
            for one in node.body if isinstance(node.body, list) else [node.body]:
                self._visit(one, inside, depth + len(arguments))
            return
        if isinstance(node, ast.Name) and node.id in names:
            self._replace(node.lineno, node.col_offset, node.id, names)
        elif isinstance(node, ast.Attribute) and node.attr in names and node.attr[0] == "_":
            at = node.end_col_offset - len(node.attr)
            self._replace(node.end_lineno, at, node.attr, names)
        for one in ast.iter_child_nodes(node):
            self._visit(one, names, depth)

    def _replace(self, line: int, column: int, name: str, names: dict[str, str]) -> None:
        self.replace((line, column), (line, column + len(name)), names[name])
