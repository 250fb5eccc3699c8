"""Removes the firmware, its settings and its calibration from a board."""

from __future__ import annotations

import sys

from ..errors import SpotsError, printable
from .flash import USER_FILES, Known, remove_folders
from .manifest import MANIFEST
from .place import place
from .staging import ENTRIES, device_of


def erase(board: str, port: str | None = None, yes: bool = False) -> None:
    """Remove the firmware's files from a board after a confirmation; other files stay.

    Parameters
    ----------
    board : str
        A name that ``spots boards`` lists.
    port : str, optional
        A serial port, or the folder of a CircuitPython drive; found if not given.
    yes : bool
        Do not ask for the confirmation.

    Raises
    ------
    SpotsError
        If there is no such board, it runs another runtime, or the user does not confirm.
    """
    device = device_of(board)
    entry = ENTRIES[device.runtime][-1]
    with place(device, port) as there:
        if not yes:
            _ask(there.name)
        with there.open() as target:
            if target.facts["runtime"] != device.runtime:
                raise SpotsError(
                    f"the board on {there.name} runs {target.facts['runtime']}, and {board} "
                    f"{device.runtime}: name the right board"
                )
            known = Known(target, device.runtime, USER_FILES)
            ours = {
                path
                for path in known.sizes
                if known.claimed and (path in USER_FILES or known.is_ours(path))
            }
            changed = sorted(known.listed & set(known.sizes) - ours)
            if changed:
                ours.discard(MANIFEST)  # without it their names alone would mark them as ours
            # The entry file first: a partial firmware must not start. The manifest, which lists the
            # rest, last.
            order = {entry: 0, MANIFEST: 2}
            for path in sorted(ours, key=lambda path: (order.get(path, 1), path)):
                target.remove(path)
            remove_folders(target, ours)
            target.reset()
        print(
            f"{len(ours)} files removed from {printable(there.name)}"
            if ours
            else "nothing to remove"
        )
        if changed:
            names = printable(", ".join(changed))
            print(f"these were changed since they were flashed, and stay: {names}")


def _ask(port: str) -> None:
    if not sys.stdin.isatty():
        raise SpotsError("erasing asks first: add --yes where nobody can answer")
    question = (
        f"remove the firmware, its settings and its calibration from {printable(port)}? [y/N] "
    )
    try:
        answer = input(question)
    except EOFError:
        print()  # ends the line of the question
        answer = ""
    if answer.strip().lower() not in ("y", "yes"):
        raise SpotsError("nothing was removed")
