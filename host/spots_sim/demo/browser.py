"""Opens the web UI in a browser if this computer can show it, see `opens`."""

from __future__ import annotations

import os
import sys
import webbrowser
from importlib.util import find_spec


def opens() -> bool:
    """Return whether this computer can show the web UI.

    It needs a screen, the package aiohttp, and a terminal as standard output.
    """
    screen = sys.platform in ("win32", "darwin") or any(
        os.environ.get(name) for name in ("DISPLAY", "WAYLAND_DISPLAY")
    )
    return screen and sys.stdout.isatty() and find_spec("aiohttp") is not None


def show(url: str) -> None:
    """Open an address in a browser if `opens` returns True."""
    if opens():
        webbrowser.open(url)
