"""Removes the firmware from a board, with its settings, calibration and layout of keys."""

from ..errors import BoardError, printable
from .confirm import confirm
from .flash import USER_FILES, Known, remove_folders
from .manifest import MANIFEST
from .place import place
from .staging import ENTRIES, device_of


def erase(board: str, port: str | None = None, yes: bool = False) -> None:
    """Ask for a confirmation, then remove the firmware and its stored data from a board.

    Its data are settings, calibration and layout of keys. Other files stay, and also files of the
    firmware that were changed after the flash. `port` may be the folder of a CircuitPython drive;
    without it, the board is found. SpotsError if the board is not found or has another runtime, or
    the user does not confirm.
    """
    device = device_of(board)
    entry = ENTRIES[device.runtime][-1]
    with place(device, port) as there:
        if not yes:
            what = f"the firmware, its settings, calibration and layout from {there.name}"
            confirm("erase", f"remove {what}?", "nothing was removed")
        with there.open() as target:
            if target.facts["runtime"] != device.runtime:
                raise BoardError(
                    f"the board on {there.name} runs {target.facts['runtime']}, but a board of "
                    f"type {board} needs {device.runtime}: give the type of this board",
                    "other_runtime",
                )
            known = Known(target, device.runtime, USER_FILES)
            ours = {path for path in known.sizes if known.claimed and known.is_ours(path)}
            changed = sorted(known.listed & set(known.sizes) - ours)
            if changed:
                # The changed files stay. Without the manifest, `Known` would take them for files of
                # the firmware, because of their names.
                ours.discard(MANIFEST)
            # The entry file first, since a partial firmware must not start. The manifest last:
            # after an interruption it still lists the firmware's files.
            order = {entry: 0, MANIFEST: 2}
            for path in sorted(ours, key=lambda path: (order.get(path, 1), path)):
                target.remove(path)
            remove_folders(target, ours)
            target.reset()
        done = f"{len(ours)} files removed from {there.name}" if ours else "nothing to remove"
        print(printable(done))
        if changed:
            names = printable(", ".join(changed))
            print(f"these files stay, because they were changed after the flash: {names}")
