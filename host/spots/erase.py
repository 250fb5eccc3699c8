"""The firmware, its settings and its calibration off a board."""

from __future__ import annotations

import sys

from .errors import SpotsError
from .flash import ENTRY, USER_FILES, at_port, is_ours
from .prompt import Prompt
from .stage import device_of


def erase(board: str, port: str | None = None, yes: bool = False) -> None:
    """Remove our files from a board, once the user said yes; other files stay.

    Raises
    ------
    SpotsError
        If there is no such board, it runs another runtime, or nobody can be asked.
    """
    device = device_of(board)
    with at_port(board, port) as name:
        if not yes:
            _ask(name)
        with Prompt(name) as prompt:
            try:
                if prompt.facts["runtime"] != device.runtime:
                    raise SpotsError(
                        f"the board on {name} runs {prompt.facts['runtime']}, and {board} "
                        f"{device.runtime}: name the right board"
                    )
                # The entry first: what is left of the rest must not start.
                ours = [path for path in prompt.files() if is_ours(path) or path in USER_FILES]
                for path in sorted(ours, key=lambda path: (path != ENTRY, path)):
                    prompt.remove(path)
                folders = {path.rpartition("/")[0] for path in ours} - {""}
                for folder in sorted(folders, reverse=True):
                    prompt.run(f"import os\nos.rmdir({folder!r})")
            finally:
                prompt.reset()
        print(f"{len(ours)} files removed from {name}" if ours else "nothing to remove")


def _ask(port: str) -> None:
    if not sys.stdin.isatty():
        raise SpotsError("erasing asks first: add --yes where nobody can answer")
    question = f"remove the firmware, its settings and its calibration from {port}? [y/N] "
    if input(question).strip().lower() not in ("y", "yes"):
        raise SpotsError("nothing was removed")
