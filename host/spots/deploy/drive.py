"""The drive of a CircuitPython board: its files listed, hashed, written and removed."""

from __future__ import annotations

import errno
import hashlib
import os
import re
import shutil
import stat
import sys
from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from pathlib import Path

from ..errors import SpotsError, missing
from .nofollow import Tree
from .prompt import Prompt

_ABOUT = "boot_out.txt"  # CircuitPython writes it at every start
_ABOUT_BYTES = 4096  # more than it ever has
_VERSION = re.compile(r"CircuitPython (\d+)\.(\d+)\.(\d+)")
_BOARD_ID = re.compile(r"Board ID: ?(\S+)")
_UID = re.compile(r"UID: ?(\S+)")
_FAT = ("vfat", "msdos", "fat", "fat12", "fat16", "fat32")
_BLOCK_DEVICES = Path("/sys/class/block")
_CHUNK = 1 << 16
_CLUSTER = 4096  # larger than on any such drive
_READ_ONLY = (errno.EROFS, errno.EACCES, errno.EPERM)


class Drive:
    """A mounted CIRCUITPY drive, as `deploy.prompt.Prompt` is a board's file system.

    Nothing outside it is ever read, written or removed: no link on it is followed.

    Parameters
    ----------
    folder : str
        Where it is mounted.
    console : str, optional
        The board's serial port with the prompt, used to restart it.

    Attributes
    ----------
    facts : dict
        ``runtime``, ``version``, ``board_id``, ``uid``, ``block`` and ``free`` (bytes).

    Raises
    ------
    SpotsError
        If the folder is not a CircuitPython drive.
    """

    def __init__(self, folder: str, console: str | None = None):
        self.port = folder
        self._console = console
        self._tree = None
        try:
            self._tree = Tree(folder)
            with self._tree.open(_ABOUT) as file:
                about = file.read(_ABOUT_BYTES).decode("utf-8", errors="replace")
            free = shutil.disk_usage(folder).free
        except OSError:
            about = ""
        except SpotsError:
            self.close()
            raise
        version = _VERSION.search(about)
        if not version:
            self.close()
            raise SpotsError(
                f"{folder} is not a CircuitPython drive: give the one that holds {_ABOUT}"
            )
        board_id, uid = _BOARD_ID.search(about), _UID.search(about)
        self.facts = {
            "runtime": "circuitpython",
            "version": tuple(map(int, version.groups())),
            "board_id": board_id and board_id[1],
            "uid": uid and uid[1],
            "block": _CLUSTER,
            "free": free,
        }

    def __enter__(self) -> Drive:
        return self

    def __exit__(self, *exception) -> None:
        self.close()

    def close(self) -> None:
        """Close the drive, so that it can be ejected."""
        if self._tree is not None:
            self._tree.close()

    def files(self, paths: Iterable[str]) -> dict[str, int]:
        """Return the sizes of the files that exist among these, by path."""
        with self._explained():
            sizes = {path: self._tree.size(path) for path in paths}
        return {path: size for path, size in sizes.items() if size is not None}

    def read(self, path: str, size: int) -> bytes:
        """Return the first bytes of a file, at most `size` of them.

        Parameters
        ----------
        path : str
            On the drive, with ``/`` between its parts.
        size : int
            Largest number of bytes.

        Returns
        -------
        bytes

        Raises
        ------
        SpotsError
            If the file cannot be read, or a link leads out of the drive.
        """
        with self._explained(), self._tree.open(path) as file:
            return file.read(size)

    def sha256(self, path: str) -> str:
        """Return the hash of a file, in hexadecimal."""
        digest = hashlib.sha256()
        with self._explained(), self._tree.open(path) as file:
            while chunk := file.read(_CHUNK):
                digest.update(chunk)
        return digest.hexdigest()

    def remove(self, path: str) -> None:
        """Remove a file."""
        with self._explained():
            self._tree.remove(path)

    def remove_folder(self, path: str) -> None:
        """Remove a folder if it is empty."""
        try:
            self._tree.remove_folder(path)
        except OSError:
            pass  # it holds files of the user

    def write(self, path: str, data: bytes) -> None:
        """Write a file under a temporary name, and rename it once it is on the drive.

        Parameters
        ----------
        path : str
            On the drive; folders on the way are created.
        data : bytes
            The whole content.

        Raises
        ------
        SpotsError
            If the file cannot be written, or a link leads out of the drive.
        """
        with self._explained():
            self._tree.write(path, data)

    def reset(self) -> None:
        """Restart the board, or ask the user to, where its prompt cannot be reached."""
        try:
            if self._console:
                Prompt(self._console).reset()
                return
        except SpotsError:
            pass  # the line below says what to do
        print("press the board's reset button")

    @contextmanager
    def _explained(self) -> Iterator[None]:
        try:
            yield
        except OSError as error:
            if error.errno == errno.ENOSPC:
                raise SpotsError(
                    f"the drive {self.port} is full: remove files of yours from it and flash again"
                ) from None
            if error.errno in _READ_ONLY:
                raise SpotsError(
                    f"the drive {self.port} is read-only, for the board itself writes to it: "
                    "reset the board, hold its button for two seconds right after that, and flash "
                    "again when the drive is back"
                ) from None
            raise SpotsError(
                f"the drive {self.port} fails ({error.strerror}): replug the board and flash again"
            ) from None


def drives() -> list[str]:
    """Return where the CircuitPython drives of this machine are mounted: FAT, and removable.

    Raises
    ------
    SpotsError
        If psutil is missing.
    """
    try:
        import psutil
    except ImportError:
        raise missing(
            "finding a drive needs", "psutil", "flash", ", or name its folder with --port"
        ) from None
    return sorted(
        mounted.mountpoint
        for mounted in psutil.disk_partitions()
        if mounted.fstype.lower() in _FAT
        and _is_removable(mounted)
        and _is_file(os.path.join(mounted.mountpoint, _ABOUT))
    )


def _is_removable(mounted) -> bool:
    if sys.platform == "win32":
        return "removable" in mounted.opts.split(",")
    if sys.platform == "darwin":
        return mounted.mountpoint.startswith("/Volumes/")
    # A partition has no such file, and lies in the folder of its disk, which has.
    device = (_BLOCK_DEVICES / Path(mounted.device).name).resolve()
    return "1" in (_first_character(place / "removable") for place in (device, device.parent))


def _first_character(path: Path) -> str:
    try:
        return path.read_text()[:1]
    except OSError:
        return ""


def _is_file(path: str) -> bool:
    try:
        return stat.S_ISREG(os.lstat(path).st_mode)
    except OSError:  # another user's drive may not even be listed
        return False
