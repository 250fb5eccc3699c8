"""Files beneath a folder, reached without following a link in any part of their path."""

from __future__ import annotations

import contextlib
import errno
import os
import stat
from collections.abc import Iterator
from typing import BinaryIO

from ..errors import SpotsError

# Windows opens no file relative to a folder: there each part is examined right before it is used.
_BY_HANDLE = os.open in os.supports_dir_fd
_FOLDER = os.O_RDONLY | getattr(os, "O_DIRECTORY", 0) | getattr(os, "O_NOFOLLOW", 0)
# Without O_NONBLOCK, opening a FIFO that was swapped in blocks for ever.
_READ = (
    os.O_RDONLY
    | getattr(os, "O_NOFOLLOW", 0)
    | getattr(os, "O_NONBLOCK", 0)
    | getattr(os, "O_BINARY", 0)
)
_CREATE = (
    os.O_WRONLY | os.O_CREAT | os.O_EXCL | getattr(os, "O_NOFOLLOW", 0) | getattr(os, "O_BINARY", 0)
)
_NOT_PLAIN = (errno.ELOOP, errno.EMLINK, errno.ENOTDIR, errno.ENXIO)  # links, FIFOs, sockets


class Tree:
    """A folder and the files beneath it, on one file system and through no link.

    Paths have `/` between their parts and no part that is empty, ``.`` or ``..``.

    Parameters
    ----------
    folder : str
        Its own path may pass through links.

    Raises
    ------
    OSError
        Here and from every method, if the file system fails.
    SpotsError
        From every method that meets a link, a device, or a folder where a file should be.
    """

    def __init__(self, folder: str):
        self.folder = folder
        self._root = self._device = None
        if _BY_HANDLE:
            self._root = os.open(folder, os.O_RDONLY | os.O_DIRECTORY)
            self._device = os.fstat(self._root).st_dev

    def close(self) -> None:
        if self._root is not None:
            os.close(self._root)
            self._root = None

    def size(self, path: str) -> int | None:
        """Return the size of a file, or None if it does not exist."""
        try:
            with self._parent(path) as (parent, name):
                return self._status(path, parent, name).st_size
        except FileNotFoundError:
            return None

    @contextlib.contextmanager
    def open(self, path: str) -> Iterator[BinaryIO]:
        """Open a file for reading."""
        with self._parent(path) as (parent, name):
            self._status(path, parent, name)
            handle = self._open(path, name, _READ, parent)
        with os.fdopen(handle, "rb") as file:
            self._check(path, stat.S_ISREG, os.fstat(handle))
            yield file

    def write(self, path: str, data: bytes) -> None:
        """Write a file under a temporary name, and rename it once it is on the disk.

        Parameters
        ----------
        path : str
            Below the folder; folders on the way are created.
        data : bytes
            The whole content.

        Raises
        ------
        OSError
            If the file system fails.
        SpotsError
            If the path meets a link, a device, or a folder where the file should be.
        """
        with self._parent(path, make=True) as (parent, name):
            part = name + ".part"
            with contextlib.suppress(FileNotFoundError):
                os.unlink(part, dir_fd=parent)
            handle = os.open(part, _CREATE, 0o666, dir_fd=parent)
            try:
                with os.fdopen(handle, "wb") as file:
                    file.write(data)
                    file.flush()
                    os.fsync(handle)
                os.replace(part, name, src_dir_fd=parent, dst_dir_fd=parent)
                settle(parent)
            except OSError:
                with contextlib.suppress(OSError):  # the drive itself was unplugged
                    os.unlink(part, dir_fd=parent)
                raise

    def remove(self, path: str) -> None:
        """Remove a file."""
        with self._parent(path) as (parent, name):
            self._status(path, parent, name)
            os.unlink(name, dir_fd=parent)
            settle(parent)

    def remove_folder(self, path: str) -> None:
        """Remove a folder; OSError if anything is in it."""
        with self._parent(path) as (parent, name):
            os.rmdir(name, dir_fd=parent)

    @contextlib.contextmanager
    def _parent(self, path: str, make: bool = False) -> Iterator[tuple[int | None, str]]:
        """Yield what `dir_fd` takes for the folder of a path, and the name to use with it."""
        *folders, name = path.split("/")
        walk = self._by_handle if _BY_HANDLE else self._by_path
        with walk(folders, make) as (parent, prefix):
            yield parent, prefix + name

    @contextlib.contextmanager
    def _by_handle(self, folders: list[str], make: bool) -> Iterator[tuple[int, str]]:
        handle = os.dup(self._root)
        try:
            for i, folder in enumerate(folders):
                if make:
                    with contextlib.suppress(FileExistsError):
                        os.mkdir(folder, dir_fd=handle)
                path = "/".join(folders[: i + 1])
                inner = self._open(path, folder, _FOLDER, handle)
                os.close(handle)
                handle = inner
                self._check(path, stat.S_ISDIR, os.fstat(handle))
            yield handle, ""
        finally:
            os.close(handle)

    @contextlib.contextmanager
    def _by_path(self, folders: list[str], make: bool) -> Iterator[tuple[None, str]]:
        place = self.folder
        for i, folder in enumerate(folders):
            place = os.path.join(place, folder)
            if make:
                with contextlib.suppress(FileExistsError):
                    os.mkdir(place)
            self._check("/".join(folders[: i + 1]), stat.S_ISDIR, os.lstat(place))
        yield None, os.path.join(place, "")

    def _open(self, path: str, name: str, flags: int, parent: int | None) -> int:
        try:
            return os.open(name, flags, dir_fd=parent)
        except OSError as error:
            if error.errno in _NOT_PLAIN:
                self._refuse(path)
            raise

    def _status(self, path: str, parent: int | None, name: str) -> os.stat_result:
        status = os.stat(name, dir_fd=parent, follow_symlinks=False)
        self._check(path, stat.S_ISREG, status)
        return status

    def _check(self, path: str, is_kind, status: os.stat_result) -> None:
        # Of Windows: junctions and all else that leads to another place.
        leads_away = getattr(status, "st_file_attributes", 0) & stat.FILE_ATTRIBUTE_REPARSE_POINT
        if self._device not in (None, status.st_dev):
            leads_away = True  # something else is mounted there
        if leads_away or not is_kind(status.st_mode):
            self._refuse(path)

    def _refuse(self, path: str) -> None:
        raise SpotsError(
            f"{path} on {self.folder} is a link, or not a plain file or folder of this drive: "
            "remove it there, or give another drive"
        )


def settle(folder: int | None) -> None:
    """Flush a folder, so that renames reach the disk in order and before a reset."""
    if folder is not None:  # on Windows a removable drive keeps nothing back
        os.fsync(folder)
