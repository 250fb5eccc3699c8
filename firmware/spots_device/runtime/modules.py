"""Modules that a board imports for one call: their code needs heap only meanwhile."""

import sys


def drop(module):
    """Remove a module of a package from the memory of a board; the next import reads it again.

    The garbage collection frees it when no object of the module is in use.
    """
    if sys.implementation.name == "cpython":
        return
    package, _, name = module.__name__.rpartition(".")
    sys.modules.pop(module.__name__, None)
    if hasattr(sys.modules[package], name):
        delattr(sys.modules[package], name)
