"""What runs the firmware of a virtual board, and what its serial port is made of."""

from __future__ import annotations

import importlib.util
import os

from spots.deploy.staging import device_of
from spots.errors import SpotsError

from .vm import micropython_command

# Environment variables, with the values that they take. Unset, the machine decides.
_RUNTIME = "SPOTS_VIRTUAL_RUNTIME", ("micropython", "cpython")
_PORT = "SPOTS_VIRTUAL_PORT", ("pty", "socket")


def is_cpython(board: str = "virtual") -> bool:
    """Return whether the firmware runs in this Python, because there is no MicroPython.

    Raises
    ------
    SpotsError
        If the environment variable has another value.
    """
    if device_of(board).runtime != "micropython":
        return False
    return (_wanted(*_RUNTIME) or _there_is()) == "cpython"


def is_socket() -> bool:
    """Return whether the serial port is a TCP socket on loopback, because there is no PTY.

    Raises
    ------
    SpotsError
        If the environment variable has another value.
    """
    there_is = "pty" if importlib.util.find_spec("termios") else "socket"
    return (_wanted(*_PORT) or there_is) == "socket"


def headline(runtime: str = "") -> str:
    """Return the first line of a demonstration: what runs the firmware, and why.

    Parameters
    ----------
    runtime : str
        As a board names it, if one was asked.
    """
    if not is_cpython():
        return f"runtime: {runtime or 'micropython'}"
    why = f"as ${_RUNTIME[0]} asks" if os.environ.get(_RUNTIME[0]) else "no MicroPython here"
    return f"runtime: {runtime or 'cpython'} ({why})"


def _there_is() -> str:
    try:
        micropython_command()
    except SpotsError:
        return "cpython"
    return "micropython"


def _wanted(name: str, values: tuple[str, str]) -> str | None:
    value = os.environ.get(name) or None
    if value not in (None, *values):
        raise SpotsError(f"${name} is one of {', '.join(values)}, not '{value}'")
    return value
