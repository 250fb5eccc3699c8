"""Docstrings of the public API say what the signatures have: numpydoc, with every parameter.

The public API is what `spots` exports and the public functions of the modules that it comes from.
"""

from __future__ import annotations

import ast
import inspect
import re
import textwrap
from dataclasses import is_dataclass
from importlib import import_module

import pytest

import spots

SECTION = re.compile(r"^(\w[\w ]*)\n-{3,}\n", re.MULTILINE)
ITEM = re.compile(r"^(\*{0,2}\w+(?:, \*{0,2}\w+)*)(?: :|$)", re.MULTILINE)
MODULES = [import_module(f"spots.{name}") for name in dict.fromkeys(spots._MODULES.values())]
EXPORTED = [getattr(spots, name) for name in spots.__all__]


def public(of):
    """Return the public functions that a module or a class defines."""
    module = getattr(of, "__module__", None) or of.__name__
    return [
        one
        for name, one in vars(of).items()
        if inspect.isfunction(one) and not name.startswith("_") and one.__module__ == module
    ]


# Of a NamedTuple and a dataclass the docstring explains what their names do not.
CLASSES = [one for one in EXPORTED if inspect.isclass(one)]
MADE = [one for one in CLASSES if not hasattr(one, "_fields") and not is_dataclass(one)]
FUNCTIONS = [function for of in (*MODULES, *CLASSES) for function in public(of)]


def sections(of):
    """Return the sections of a docstring by their titles."""
    _, *parts = SECTION.split(inspect.getdoc(of) or "")
    return dict(zip(parts[::2], parts[1::2]))


def named(section):
    """Return the names that a section of a docstring has entries for."""
    return [name for item in ITEM.findall(section) for name in item.split(", ")]


def parameters(of):
    """Return the parameters of a function or class as a docstring has them."""
    stars = {inspect.Parameter.VAR_POSITIONAL: "*", inspect.Parameter.VAR_KEYWORD: "**"}
    found = inspect.signature(of).parameters.values()
    return [stars.get(one.kind, "") + one.name for one in found if one.name != "self"]


def raised(function):
    """Return the names of the errors that a function itself raises."""
    tree = ast.parse(textwrap.dedent(inspect.getsource(function)))
    errors = [node.exc for node in ast.walk(tree) if isinstance(node, ast.Raise)]
    return {ast.unparse(one.func) for one in errors if isinstance(one, ast.Call)}


def name_of(one):
    return f"{one.__module__}.{one.__qualname__}"


@pytest.mark.parametrize("function", FUNCTIONS, ids=name_of)
def test_a_function_documents_all_of_its_parameters_and_what_it_returns(function):
    wanted, found = parameters(function), sections(function)
    if "Parameters" in found or len(wanted) >= 2:
        assert named(found.get("Parameters", "")) == wanted
    if len(wanted) >= 2 and inspect.signature(function).return_annotation not in ("None", None):
        assert {"Returns", "Yields"} & set(found)
    if len(wanted) >= 2 or "Raises" in found:
        assert raised(function) <= set(named(found.get("Raises", "")))


@pytest.mark.parametrize("made", MADE, ids=name_of)
def test_a_class_documents_what_it_is_made_from(made):
    found, wanted = sections(made), parameters(made)
    if "Parameters" in found or len(wanted) >= 2:
        assert named(found.get("Parameters", "")) == wanted
