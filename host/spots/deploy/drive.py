"""The USB drive of a CircuitPython board: finds it, and reads and writes its files."""

import os
import re
import shutil
import stat
import sys
from contextlib import suppress
from pathlib import Path

from ..errors import PortError, SpotsError, missing
from .nofollow import Tree
from .prompt import Prompt

_ABOUT = "boot_out.txt"  # CircuitPython writes this file at every start
_ABOUT_BYTES = 4096  # more than this file ever has
_VERSION = re.compile(r"CircuitPython (\d+)\.(\d+)\.(\d+)")
_BOARD_ID = re.compile(r"Board ID: ?(\S+)|$")
_UID = re.compile(r"UID: ?(\S+)|$")
_FAT = ("vfat", "msdos", "fat", "fat12", "fat16", "fat32")
_BLOCK_DEVICES = Path("/sys/class/block")
_CLUSTER = 4096  # bytes; assumed size of a cluster, at least that of every CIRCUITPY drive


class Drive(Tree):
    """A mounted CIRCUITPY drive, with the same file operations as `deploy.prompt.Prompt`.

    Symbolic links on the drive are not followed, so nothing outside the drive is ever read, written
    or removed. `console` is the serial port of the board's prompt, through which `reset` restarts
    the board. `facts` are ``runtime``, ``version`` (tuple of 3 int), ``board_id``, ``uid`` (id of
    the chip; None if unknown), and of the file system ``block`` (size of a block) and ``free``, in
    bytes. PortError if the folder is not a CircuitPython drive.
    """

    def __init__(self, folder: str, console: str | None = None):
        self._console = console
        about, free = "", 0
        with suppress(OSError):
            super().__init__(folder)
            free = shutil.disk_usage(folder).free
            if self.files([_ABOUT]):
                about = self.read(_ABOUT, _ABOUT_BYTES).decode("utf-8", errors="replace")
        version = _VERSION.search(about)
        if not version:
            raise PortError(
                f"{folder} is not a CircuitPython drive: name the folder that has {_ABOUT}"
            )
        self.facts = {
            "runtime": "circuitpython",
            "version": tuple(map(int, version.groups())),
            "board_id": _BOARD_ID.search(about)[1],
            "uid": _UID.search(about)[1],
            "block": _CLUSTER,
            "free": free,
        }

    def reset(self) -> None:
        """Restart the board, or ask the user to restart it if its prompt cannot be reached."""
        if self._console:
            with suppress(SpotsError):
                Prompt(self._console).reset()
                return
        print("press the board's reset button, to restart the board")


def drives() -> list[str]:
    """Return the folders of mounted CircuitPython drives; see `removable`."""
    return removable(_ABOUT)


def removable(name: str) -> list[str]:
    """Return the folders of mounted removable FAT drives that have a file of this name.

    RequirementError if psutil is missing.
    """
    try:
        import psutil
    except ImportError:
        raise missing(
            "finding a drive needs", "psutil", "flash", ", or name the drive's folder with --port"
        ) from None
    return sorted(
        mounted.mountpoint
        for mounted in psutil.disk_partitions()
        if mounted.fstype.lower() in _FAT
        and _is_removable(mounted)
        and _is_file(os.path.join(mounted.mountpoint, name))
    )


def _is_removable(mounted) -> bool:
    if sys.platform == "win32":
        return "removable" in mounted.opts.split(",")
    if sys.platform == "darwin":
        return mounted.mountpoint.startswith("/Volumes/")
    # Only a whole disk has this file; a partition's folder lies in the folder of its disk.
    device = (_BLOCK_DEVICES / Path(mounted.device).name).resolve()
    for folder in (device, device.parent):
        with suppress(OSError):
            return (folder / "removable").read_text().startswith("1")
    return False


def _is_file(path: str) -> bool:
    with suppress(OSError):  # another user's drive may refuse even this
        return stat.S_ISREG(os.lstat(path).st_mode)
    return False
