"""Reads and writes files below a folder; symbolic links in a path are refused, not followed."""

import contextlib
import errno
import hashlib
import os
import stat
from collections.abc import Iterable, Iterator
from typing import BinaryIO

from ..errors import FileError, PortError

_READ_ONLY = (errno.EROFS, errno.EACCES, errno.EPERM)
_CHUNK = 1 << 16


class Tree:
    """A folder and the files below it, on one file system; links are never followed.

    Each part of a path is checked right before its use. The parts are separated by ``/``. No part
    may be empty, ``.`` or ``..``. Only the path of the folder itself may contain links; error
    messages call it the drive. OSError if it does not exist.

    The methods raise SpotsError if the file system reports an error; if a part of the path is a
    link or a special file, or is on another file system; if the path of a file leads to a folder,
    or that of a folder to a file.
    """

    def __init__(self, folder: str):
        self.port = folder
        self._device = os.stat(folder).st_dev

    def __enter__(self):
        return self

    def __exit__(self, *exception) -> None:
        pass

    def files(self, paths: Iterable[str]) -> dict[str, int]:
        """Return the size in bytes of each file in `paths` that exists, by its path."""
        sizes = {}
        with self._explained():
            for path in paths:
                with contextlib.suppress(FileNotFoundError):
                    sizes[path] = os.lstat(self._file(path)).st_size
        return sizes

    def read(self, path: str, size: int) -> bytes:
        """Return the first bytes of a file, at most `size`."""
        with self._open(path) as file:
            return file.read(size)

    def sha256(self, path: str) -> str:
        """Return the SHA-256 of a file, in hexadecimal."""
        digest = hashlib.sha256()
        with self._open(path) as file:
            while chunk := file.read(_CHUNK):
                digest.update(chunk)
        return digest.hexdigest()

    def write(self, path: str, data: bytes) -> None:
        """Write a file under a temporary name, and rename the file when the disk has stored it.

        Missing folders are created.
        """
        with self._explained():
            name = self._in_folder(path, make=True)
            part = name + ".part"
            with contextlib.suppress(FileNotFoundError):
                os.unlink(part)
            try:
                with open(part, "xb") as file:
                    file.write(data)
                    file.flush()
                    os.fsync(file.fileno())
                os.replace(part, name)
                settle(os.path.dirname(name))
            except OSError:
                with contextlib.suppress(OSError):  # the drive itself was unplugged
                    os.unlink(part)
                raise

    def remove(self, path: str) -> None:
        """Remove a file."""
        with self._explained():
            name = self._file(path)
            os.unlink(name)
            settle(os.path.dirname(name))

    def rename(self, path: str, new: str) -> None:
        """Rename a file in its folder; no file may have the new path."""
        with self._explained():
            name = self._file(path)
            os.rename(name, self._in_folder(new))
            settle(os.path.dirname(name))

    def remove_folder(self, path: str) -> None:
        """Remove a folder if it is empty."""
        with contextlib.suppress(OSError):
            os.rmdir(self._in_folder(path))

    @contextlib.contextmanager
    def _open(self, path: str) -> Iterator[BinaryIO]:
        with self._explained(), open(self._file(path), "rb", opener=_opened) as file:
            yield file

    def _file(self, path: str) -> str:
        """Return the whole path of a file that exists, and is a plain file in plain folders."""
        name = self._in_folder(path)
        self._check(path, name, stat.S_ISREG)
        return name

    def _in_folder(self, path: str, make: bool = False) -> str:
        """Return the whole path of a file whose folders exist, and are plain folders.

        If `make` is true, a missing folder is created.
        """
        *folders, name = path.split("/")
        whole, so_far = self.port, ""
        for folder in folders:
            whole, so_far = os.path.join(whole, folder), f"{so_far}{folder}/"
            if make:
                with contextlib.suppress(FileExistsError):
                    os.mkdir(whole)
            self._check(so_far[:-1], whole, stat.S_ISDIR)
        return os.path.join(whole, name)

    def _check(self, path: str, whole: str, is_kind) -> None:
        status = os.lstat(whole)
        # Mounts, and junctions on Windows, also lead out of the folder.
        leads_away = getattr(status, "st_file_attributes", 0) & stat.FILE_ATTRIBUTE_REPARSE_POINT
        leads_away = leads_away or status.st_dev != self._device
        if leads_away or not is_kind(status.st_mode):
            raise FileError(
                f"{path} on {self.port} is not the plain file or folder that belongs there, but "
                f"for example a symbolic link: remove {path} from {self.port}, or choose another "
                "drive",
                path,
            )

    @contextlib.contextmanager
    def _explained(self) -> Iterator[None]:
        try:
            yield
        except OSError as error:
            if error.errno == errno.ENOSPC:
                what = "is full: remove some of your files from it, and run this command again"
            elif error.errno in _READ_ONLY:
                what = (
                    "is read-only, because the board itself may write to it: reset the board and "
                    "immediately hold its BOOT button for two seconds; when the drive is mounted "
                    "again, run this command again"
                )
            else:
                what = f"fails ({error.strerror}): replug the board, and run this command again"
            raise PortError(f"the drive {self.port} {what}") from None


def settle(folder: str) -> None:
    """Wait until the disk has stored all changes of a folder."""
    if os.name == "nt":  # it does not delay writes to a removable drive
        return
    handle = os.open(folder, os.O_RDONLY)
    try:
        os.fsync(handle)
    finally:
        os.close(handle)


def _opened(name: str, flags: int) -> int:
    return os.open(name, flags | getattr(os, "O_NOFOLLOW", 0))
