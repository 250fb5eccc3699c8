"""The drive of a CircuitPython board: its files listed, hashed, written and removed."""

from __future__ import annotations

import errno
import glob
import hashlib
import os
import re
import shutil
import string
import sys
from pathlib import Path

from .errors import SpotsError
from .prompt import Prompt

_ABOUT = "boot_out.txt"  # CircuitPython writes it at every start
_VERSION = re.compile(r"CircuitPython (\d+)\.(\d+)\.(\d+)")
_BOARD_ID = re.compile(r"Board ID: ?(\S+)")
_UID = re.compile(r"UID: ?(\S+)")
_MOUNTED = {
    "darwin": ["/Volumes/*"],
    "win32": [f"{letter}:\\" for letter in string.ascii_uppercase[3:]],
}
_LINUX = ["/media/*", "/media/*/*", "/run/media/*/*", "/mnt/*"]
_CLUSTER = 4096  # of such drives none has larger ones
_READ_ONLY = (errno.EROFS, errno.EACCES, errno.EPERM)


class Drive:
    """A mounted CIRCUITPY drive, as `prompt.Prompt` is a board's file system.

    Parameters
    ----------
    folder : str
        Where it is mounted.
    console : str, optional
        The board's serial port with the prompt, over which it is started anew.

    Attributes
    ----------
    facts : dict
        ``runtime``, ``version``, ``board_id``, ``uid``, ``block`` and ``free`` (bytes).

    Raises
    ------
    SpotsError
        If the folder is no such drive.
    """

    def __init__(self, folder: str, console: str | None = None):
        self.port = folder
        self._folder = Path(folder)
        self._console = console
        try:
            about = (self._folder / _ABOUT).read_text(encoding="utf-8", errors="replace")
            free = shutil.disk_usage(folder).free
        except OSError:
            about = ""
        version = _VERSION.search(about)
        if not version:
            raise SpotsError(
                f"{folder} is no CircuitPython drive: give the one that holds {_ABOUT}"
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
        pass

    def files(self) -> dict[str, int]:
        """Return the sizes of the files at the top, in ``tactile`` and in ``lib``, by path."""
        return self._do(self._files)

    def sha256(self, path: str) -> str:
        """Return the hash of a file, in hexadecimal."""
        return hashlib.sha256(self._do((self._folder / path).read_bytes)).hexdigest()

    def remove(self, path: str) -> None:
        """Remove a file."""
        self._do(self._remove, self._folder / path)

    def remove_folder(self, path: str) -> None:
        """Remove a folder if there is nothing in it."""
        try:
            (self._folder / path).rmdir()
        except OSError:
            pass  # somebody else's files are in it

    def write(self, path: str, data: bytes) -> None:
        """Write a file under another name, and give it its own when it is on the drive."""
        self._do(self._write, self._folder / path, data)

    def reset(self) -> None:
        """Start the board anew, or ask for it if its prompt cannot be reached."""
        try:
            if self._console:
                Prompt(self._console).reset()
                return
        except SpotsError:
            pass  # what follows says what to do
        print("press the board's reset button")

    def _files(self) -> dict[str, int]:
        found = [path for path in self._folder.iterdir() if path.is_file()]
        for name in ("tactile", "lib"):
            found += [path for path in (self._folder / name).rglob("*") if path.is_file()]
        return {path.relative_to(self._folder).as_posix(): path.stat().st_size for path in found}

    def _write(self, path: Path, data: bytes) -> None:
        path.parent.mkdir(parents=True, exist_ok=True)
        part = path.with_name(path.name + ".part")
        try:
            with part.open("wb") as file:
                file.write(data)
                file.flush()
                os.fsync(file.fileno())
            part.replace(path)
            _settle(path.parent)
        except OSError:
            try:
                part.unlink()
            except OSError:
                pass  # the drive itself is gone
            raise

    def _remove(self, path: Path) -> None:
        path.unlink()
        _settle(path.parent)

    def _do(self, function, *arguments):
        try:
            return function(*arguments)
        except OSError as error:
            if error.errno == errno.ENOSPC:
                raise SpotsError(
                    f"the drive {self.port} is full: remove files of yours from it and flash again"
                ) from None
            if error.errno in _READ_ONLY:
                raise SpotsError(
                    f"the drive {self.port} may only be read, for the board itself writes to it: "
                    "reset the board, hold its button for two seconds right after that, and flash "
                    "again when the drive is back"
                ) from None
            raise SpotsError(
                f"the drive {self.port} fails ({error.strerror}): replug the board and flash again"
            ) from None


def _settle(folder: Path) -> None:
    """Have names on the drive in the order in which they were given, and before a reset."""
    if os.name == "posix":  # elsewhere a removable drive keeps nothing back
        handle = os.open(folder, os.O_RDONLY)
        try:
            os.fsync(handle)
        finally:
            os.close(handle)


def drives() -> list[str]:
    """Return where the CircuitPython drives of this machine are mounted."""
    patterns = _MOUNTED.get(sys.platform, _LINUX)
    folders = [folder for pattern in patterns for folder in glob.glob(pattern)]
    # Of another user's drives it cannot even be asked what is there.
    return sorted(folder for folder in folders if os.path.isfile(os.path.join(folder, _ABOUT)))
