"""Whether there is a browser to open a page in, and somebody who sees it."""

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
    """Print where the page is, and open it if it would be seen."""
    print_address(url)
    if opens():
        webbrowser.open(url)


def print_address(url: str) -> None:
    """Tell where the page is."""
    print(f"the page is at {url} (Ctrl-C ends it)", flush=True)
