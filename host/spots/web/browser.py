"""Opens the page in a browser where there is a screen."""

from __future__ import annotations

import os
import sys
import webbrowser
from importlib.util import find_spec


def opens() -> bool:
    """Return whether a page would be seen if it were opened."""
    screen = sys.platform in ("win32", "darwin") or any(
        os.environ.get(name) for name in ("DISPLAY", "WAYLAND_DISPLAY")
    )
    return screen and sys.stdout.isatty() and find_spec("aiohttp") is not None


def show(url: str) -> None:
    """Print the address of the page, and open it if there is a screen."""
    print_address(url)
    if opens():
        webbrowser.open(url)


def print_address(url: str) -> None:
    """Print the address of the page."""
    print(f"the page is at {url} (Ctrl-C ends it)", flush=True)
