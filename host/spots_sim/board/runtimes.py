"""Selects the runtime of a virtual board's firmware, and the kind of its serial port."""

from __future__ import annotations

import importlib.util
import os

from spots.deploy.build import mpy_cross_command
from spots.deploy.staging import device_of
from spots.errors import SettingError, SpotsError

from .vm import micropython_command

# Environment variables and their valid values. Without them, the computer's features decide.
_RUNTIME = "SPOTS_VIRTUAL_RUNTIME", ("micropython", "cpython")
_PORT = "SPOTS_VIRTUAL_PORT", ("pty", "socket")


def is_cpython(board: str = "virtual") -> bool:
    """Return whether the firmware runs in CPython: by default, only if a tool is missing.

    The tools are MicroPython, and mpy-cross, which compiles the firmware for it. The firmware of a
    CircuitPython board never runs in CPython. SettingError if SPOTS_VIRTUAL_RUNTIME is invalid.
    """
    if device_of(board).runtime != "micropython":
        return False
    return (_wanted(*_RUNTIME) or ("cpython" if _missing() else "micropython")) == "cpython"


def is_socket() -> bool:
    """Return whether a virtual board's serial port is a TCP socket on loopback.

    By default, it is a socket only if this system has no pseudo-terminals. SettingError if the
    environment variable SPOTS_VIRTUAL_PORT is invalid.
    """
    there_is = "pty" if importlib.util.find_spec("termios") else "socket"
    return (_wanted(*_PORT) or there_is) == "socket"


def headline(runtime: str = "") -> str:
    """Return the first line of a demonstration: the firmware's runtime, and the reason if CPython.

    `runtime` is that of a board's reply to ``hello``; empty if no board is open.
    """
    if not is_cpython():
        return f"runtime: {runtime or 'micropython'}"
    why = f"${_RUNTIME[0]} is set" if os.environ.get(_RUNTIME[0]) else f"{_missing()} is missing"
    return f"runtime: {runtime or 'cpython'} ({why})"


def _missing() -> str:
    """Return the name of the first tool that is not installed; empty if there is every one."""
    for name, command in (("MicroPython", micropython_command), ("mpy-cross", mpy_cross_command)):
        try:
            command()
        except SpotsError:
            return name
    return ""


def _wanted(name: str, values: tuple[str, str]) -> str | None:
    value = os.environ.get(name) or None
    if value not in (None, *values):
        choices = " or ".join(f"'{one}'" for one in values)
        raise SettingError(
            f"the environment variable {name} must be {choices}, not '{value}': change or unset it"
        )
    return value
