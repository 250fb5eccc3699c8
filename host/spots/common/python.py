"""Processes that run Python, and files that take the names of Python's own modules.

Python looks for modules in the current folder first. There, a ``random.py`` or ``pty.py`` of the
user would run inside every process that imports this module.
"""

from __future__ import annotations

import os
import sys
import traceback
from pathlib import Path

# `python -P` would do the same, but needs Python 3.11.
_NOT_HERE = "import sys; sys.path[:] = [place for place in sys.path if place]\n"


def code_command(code: str, *words: str) -> list[str]:
    """Return a command that runs code, and imports nothing from the current folder."""
    return [sys.executable, "-c", _NOT_HERE + code, *words]


def module_command(module: str, *words: str) -> list[str]:
    """Return a command like ``python -m``, which imports nothing from the current folder."""
    run = f"import runpy; runpy.run_module({module!r}, run_name='__main__', alter_sys=True)"
    return code_command(run, *words)


def script_again() -> str:
    """Return the script's path if it runs a second time, because a package imports its name."""
    path = getattr(sys.modules["__main__"], "__file__", None) or ""
    name = Path(path).stem
    module = sys.modules.get(name) if name in sys.stdlib_module_names else None
    return path if path and getattr(module, "__file__", None) == path else ""


def shadow(error: BaseException) -> str:
    """Return the user's file that replaced a module of Python, if `error` comes from it."""
    folder = Path(sys.path[0] or os.curdir).resolve()
    if folder == Path(os.__file__).parent.resolve():
        return ""
    ran = {frame.f_code.co_filename for frame, _ in traceback.walk_tb(error.__traceback__)}
    for path in sorted(folder.glob("*.py")):
        if path.stem not in sys.stdlib_module_names:
            continue
        if str(path) in ran or f"'{path.stem}'" in str(error):
            return str(path)
    return ""
