"""Docstrings of the public API describe all parameters and results of the signatures (numpydoc).

All functions and methods of `spots` and `spots_sim` are checked, and the classes that `spots`
exports.
"""

from __future__ import annotations

import ast
import inspect
import re
from dataclasses import is_dataclass
from pathlib import Path

import pytest

import spots

HOST = Path(__file__).parents[1] / "host"
SECTION = re.compile(r"^(\w[\w ]*)\n-{3,}\n", re.MULTILINE)
ITEM = re.compile(r"^(\*{0,2}[\w.]+(?:, \*{0,2}[\w.]+)*)(?: :|$)", re.MULTILINE)
FUNCTION = (ast.FunctionDef, ast.AsyncFunctionDef)
GIVING = (ast.Return, ast.Yield, ast.YieldFrom)


def public(body, prefix):
    """Yield the names of the public functions of a body, and their nodes."""
    for node in body:
        if not isinstance(node, (*FUNCTION, ast.ClassDef)) or node.name.startswith("_"):
            continue
        if isinstance(node, ast.ClassDef):
            yield from public(node.body, f"{prefix}.{node.name}")
        elif "overload" not in map(ast.unparse, node.decorator_list):
            yield f"{prefix}.{node.name}", node


def modules():
    """Yield the names of the modules of both packages, and their statements."""
    for path in sorted(HOST.rglob("*.py")):
        name = ".".join(path.relative_to(HOST).with_suffix("").parts)
        yield name, ast.parse(path.read_text(encoding="utf-8")).body


def sections(docstring):
    """Return the sections of a docstring by their titles."""
    _, *parts = SECTION.split(docstring or "")
    return dict(zip(parts[::2], parts[1::2]))


def named(section):
    """Return the names of the entries in a section of a docstring."""
    return [name for item in ITEM.findall(section) for name in item.split(", ")]


def parameters(function):
    """Return the names of a function's parameters as in a docstring, without self."""
    of = function.args
    names = [one.arg for one in of.posonlyargs + of.args]
    names += ["*" + of.vararg.arg] if of.vararg else []
    names += [one.arg for one in of.kwonlyargs]
    names += ["**" + of.kwarg.arg] if of.kwarg else []
    return [name for name in names if name not in ("self", "cls")]


def own(node):
    """Yield the nodes of a function, without those of functions within it."""
    for child in ast.iter_child_nodes(node):
        if not isinstance(child, FUNCTION):
            yield child
            yield from own(child)


def raised(function):
    """Return the names of the errors that a function itself raises."""
    errors = [node.exc for node in own(function) if isinstance(node, ast.Raise)]
    names = [ast.unparse(one.func) for one in errors if isinstance(one, ast.Call)]
    return {name for name in names if name.rpartition(".")[2][:1].isupper()}


def gives(function):
    """Return whether a function returns or yields something."""
    if function.returns is not None:
        return ast.unparse(function.returns) not in ("None", "NoReturn")
    return any(isinstance(one, GIVING) and one.value for one in own(function))


MODULES = list(modules())
FUNCTIONS = dict(item for name, body in MODULES for item in public(body, name))
FOUND = {name: sections(ast.get_docstring(function)) for name, function in FUNCTIONS.items()}
METHODS = {
    f"{name}.{of.name}.{method.name}"
    for name, body in MODULES
    for of in body
    if isinstance(of, ast.ClassDef)
    for method in of.body
    if isinstance(method, FUNCTION)
}
# Of a method that implements a contract, the contract has the sections.
CONTRACTS = {
    (name.rpartition(".")[2], *parameters(FUNCTIONS[name]))
    for name in METHODS & set(FUNCTIONS)
    if "Parameters" in FOUND[name]
}


def is_documented_elsewhere(name):
    """Return whether another class documents the method of this name and these parameters."""
    contract = (name.rpartition(".")[2], *parameters(FUNCTIONS[name]))
    return name in METHODS and "Parameters" not in FOUND[name] and contract in CONTRACTS


CHECKED = [
    name
    for name, function in FUNCTIONS.items()
    if "Parameters" in FOUND[name]
    or (len(parameters(function)) >= 2 and not is_documented_elsewhere(name))
]


@pytest.mark.parametrize("name", CHECKED)
def test_a_function_documents_all_of_its_parameters_and_what_it_returns(name):
    function, found = FUNCTIONS[name], FOUND[name]
    wanted = parameters(function)
    assert named(found.get("Parameters", "")) == wanted
    if len(wanted) >= 2 and gives(function):
        assert {"Returns", "Yields"} & set(found)
    assert raised(function) <= set(named(found.get("Raises", "")))


def test_both_packages_are_checked():
    assert {name.partition(".")[0] for name in CHECKED} == {"spots", "spots_sim"}


EXPORTED = [getattr(spots, name) for name in spots.__all__]
# Of a NamedTuple and a dataclass the docstring explains what their names do not.
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
