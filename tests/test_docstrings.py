"""Docstrings of the public API describe all parameters and results of the signatures (numpydoc).

Public is what a package exports, what a document names, and what these return. The docstring of any
other function says in a sentence or two what its signature does not show: it has no sections.
"""

from __future__ import annotations

import ast
import inspect
import re
from dataclasses import is_dataclass
from pathlib import Path

import pytest

import spots
import spots_linkage

ROOT = Path(__file__).parents[1]
HOST = ROOT / "host"
KEYS = ROOT / "docs/science/simulator-keys.md"  # shows the fields of classes, and no function
DOCUMENTS = [
    ROOT / "README.md",
    *({*(ROOT / "docs").rglob("*.md")} - {KEYS}),
    *(ROOT / "examples").rglob("*.py"),
]
# After -m, a document names a command and not what is in its module.
NAME = re.compile(r"(?<!-m )\bspots(?:_\w+)?(?:\.\w+)+")
IMPORT = re.compile(r"^from (spots\S*) import ([\w, ]+)$", re.MULTILINE)
SECTION = re.compile(r"^(\w[\w ]*)\n-{3,}\n", re.MULTILINE)
ITEM = re.compile(r"^(\*{0,2}[\w.]+(?:, \*{0,2}[\w.]+)*)(?: :|$)", re.MULTILINE)
# Public functions return these: `open_keyboard`, `open_gamepad` and `kinematics.calibrate`.
GIVEN = {f"spots.outputs.devices.{name}" for name in ("KeySink", "Keyboard", "Gamepad")}
GIVEN |= {"spots_linkage.kinematics.Kinematics"}
FUNCTION = (ast.FunctionDef, ast.AsyncFunctionDef)
GIVING = (ast.Return, ast.Yield, ast.YieldFrom)


def public(body, prefix):
    """Yield (full name, node) of each public function and method in the statements `body`."""
    for node in body:
        if not isinstance(node, (*FUNCTION, ast.ClassDef)) or node.name.startswith("_"):
            continue
        if isinstance(node, ast.ClassDef):
            yield from public(node.body, f"{prefix}.{node.name}")
        elif "overload" not in map(ast.unparse, node.decorator_list):
            yield f"{prefix}.{node.name}", node


def modules():
    """Yield (name, statements) of each module of the packages in `host`."""
    for path in sorted(HOST.rglob("*.py")):
        name = ".".join(path.relative_to(HOST).with_suffix("").parts).removesuffix(".__init__")
        yield name, ast.parse(path.read_text(encoding="utf-8")).body


def every(node, prefix):
    """Yield (full name, node) of each function and class: also of private and nested ones."""
    for child in ast.iter_child_nodes(node):
        name = prefix
        if isinstance(child, (*FUNCTION, ast.ClassDef)):
            name = f"{prefix}.{child.name}"
            yield name, child
        yield from every(child, name)


def documented():
    """Return the full names of what the packages export, and of what the documents name."""
    kinds = [one for one in EXPORTED if hasattr(one, "__name__")]
    # What a class inherits from another one of these packages is part of it.
    kinds += [base for one in kinds for base in getattr(one, "__mro__", ())]
    names = {f"{one.__module__}.{one.__qualname__}" for one in kinds}
    for path in DOCUMENTS:
        text = path.read_text(encoding="utf-8")
        names |= {*NAME.findall(text)}
        names |= {f"{of}.{name}" for of, some in IMPORT.findall(text) for name in some.split(", ")}
    return names


def sections(docstring):
    """Return the texts of a docstring's numpydoc sections, as a dict by title."""
    _, *parts = SECTION.split(docstring or "")
    return dict(zip(parts[::2], parts[1::2]))


def named(section):
    """Return the names of the entries in a section of a docstring."""
    return [name for item in ITEM.findall(section) for name in item.split(", ")]


def parameters(function):
    """Return the names of a function's parameters in numpydoc style, without self."""
    of = function.args
    names = [one.arg for one in of.posonlyargs + of.args]
    names += ["*" + of.vararg.arg] if of.vararg else []
    names += [one.arg for one in of.kwonlyargs]
    names += ["**" + of.kwarg.arg] if of.kwarg else []
    return [name for name in names if name not in ("self", "cls")]


def own(node):
    """Yield the nodes of a function, without the nodes of nested functions."""
    for child in ast.iter_child_nodes(node):
        if not isinstance(child, FUNCTION):
            yield child
            yield from own(child)


def raised(function):
    """Return the names of the exceptions in a function's own ``raise`` statements."""
    errors = [node.exc for node in own(function) if isinstance(node, ast.Raise)]
    names = [ast.unparse(one.func) for one in errors if isinstance(one, ast.Call)]
    return {name for name in names if name.rpartition(".")[2][:1].isupper()}


def gives(function):
    """Return whether a function returns or yields a value."""
    if function.returns is not None:
        return ast.unparse(function.returns) not in ("None", "NoReturn")
    return any(isinstance(one, GIVING) and one.value for one in own(function))


def missing(function, found):
    """Yield a sentence for each item that a function's docstring lacks; `found`: its sections."""
    wanted = parameters(function)
    if (documented := named(found.get("Parameters", ""))) != wanted:
        yield f"Parameters {documented} instead of {wanted}"
    if len(wanted) >= 2 and gives(function) and not {"Returns", "Yields"} & set(found):
        yield "no Returns or Yields"
    if more := raised(function) - set(named(found.get("Raises", ""))):
        yield f"no Raises of {sorted(more)}"


# A fixture, because otherwise each process of a test run would parse all modules to collect tests.
@pytest.fixture(scope="module")
def functions():
    """Dict of all public functions: name to (node, sections of its docstring)."""
    found = dict(item for name, body in modules() for item in public(body, name))
    return {name: (node, sections(ast.get_docstring(node))) for name, node in found.items()}


@pytest.fixture(scope="module")
def checked(functions):
    """The functions of the public API, and all other functions with a list of parameters."""
    api = documented()
    return {
        name: (node, found)
        for name, (node, found) in functions.items()
        if "Parameters" in found
        or (len(parameters(node)) >= 2 and {name, name.rpartition(".")[0]} & api)
    }


@pytest.mark.board
def test_each_function_documents_all_of_its_parameters_and_what_it_returns(checked):
    lacks = {name: list(missing(*of)) for name, of in checked.items()}
    assert not {name: what for name, what in lacks.items() if what}


# The fields of a class may be explained one by one: there are files whose keys they are.
ALLOWED = {ast.ClassDef: {"Attributes"}, ast.FunctionDef: set(), ast.AsyncFunctionDef: set()}


def test_what_is_not_public_says_why_in_a_sentence_and_has_no_sections():
    api = documented() | GIVEN
    found = [one for name, body in modules() for one in every(ast.Module(body, []), name)]
    hidden = [
        (name, node)
        for name, node in found
        if node.name.startswith("_") or not {name, name.rpartition(".")[0]} & api
    ]
    assert not [
        name for name, node in hidden if {*sections(ast.get_docstring(node))} - ALLOWED[type(node)]
    ]


def test_the_public_api_is_checked(checked):
    assert {"spots.link.readings.Readings.subscribe", "spots.link.connect.open"} <= {*checked}
    assert "spots_linkage.twin_source.opened" in checked  # only a document names it


EXPORTED = [getattr(of, name) for of in (spots, spots_linkage) for name in of.__all__]
# The docstring of a NamedTuple or a dataclass explains only fields whose names are not clear.
MADE = [
    one
    for one in EXPORTED
    if inspect.isclass(one) and not hasattr(one, "_fields") and not is_dataclass(one)
]


@pytest.mark.parametrize("made", MADE, ids=lambda made: f"{made.__module__}.{made.__qualname__}")
def test_a_class_documents_what_it_is_made_from(made):
    found = sections(inspect.getdoc(made))
    stars = {inspect.Parameter.VAR_POSITIONAL: "*", inspect.Parameter.VAR_KEYWORD: "**"}
    wanted = [
        stars.get(one.kind, "") + one.name for one in inspect.signature(made).parameters.values()
    ]
    if "Parameters" in found or len(wanted) >= 2:
        assert named(found.get("Parameters", "")) == wanted
