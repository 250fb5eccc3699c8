"""Reads and writes files below a folder; symbolic links in a path are refused, not followed."""

import contextlib
import errno
import hashlib
import os
import stat
from collections.abc import Iterable, Iterator
from typing import BinaryIO

from ..errors import SpotsError

# Windows cannot open a file relative to a folder. On Windows, each part of a path is therefore
# checked right before its use.
_BY_HANDLE = os.open in os.supports_dir_fd
_PLAIN = getattr(os, "O_NOFOLLOW", 0) | getattr(os, "O_BINARY", 0)
_FOLDER = os.O_RDONLY | getattr(os, "O_DIRECTORY", 0) | _PLAIN
# Without O_NONBLOCK, opening a FIFO that somebody put on the drive blocks for ever.
_READ = os.O_RDONLY | getattr(os, "O_NONBLOCK", 0) | _PLAIN
_CREATE = os.O_WRONLY | os.O_CREAT | os.O_EXCL | _PLAIN
_NOT_PLAIN = (errno.ELOOP, errno.EMLINK, errno.ENOTDIR, errno.ENXIO)  # links, FIFOs, sockets
_READ_ONLY = (errno.EROFS, errno.EACCES, errno.EPERM)
_CHUNK = 1 << 16


class Tree:
    """A folder and the files below it, on one file system; links are never followed.

    The parts of a path are separated by ``/``. No part may be empty, ``.`` or ``..``.

    Parameters
    ----------
    folder : str
        Path of the folder. This path itself may contain links.

    Attributes
    ----------
    port : str
        Path of the folder; error messages call it the drive.

    Raises
    ------
    OSError
        If the folder cannot be opened.
    SpotsError
        Raised by the methods if the file system reports an error; if a part of the path is a link
        or a special file, or is on another file system; if the path of a file leads to a folder, or
        that of a folder to a file.
    """

    def __init__(self, folder: str):
        self.port = folder
        self._root = self._device = None
        if _BY_HANDLE:
            self._root = os.open(folder, os.O_RDONLY | os.O_DIRECTORY)
            self._device = os.fstat(self._root).st_dev

    def __enter__(self):
        return self

    def __exit__(self, *exception) -> None:
        self.close()

    def close(self) -> None:
        """Close the folder, so that its drive can be ejected."""
        if self._root is not None:
            os.close(self._root)
            self._root = None

    def files(self, paths: Iterable[str]) -> dict[str, int]:
        """Return the size in bytes of each file in `paths` that exists, by its path."""
        sizes = {}
        with self._explained():
            for path in paths:
                with contextlib.suppress(FileNotFoundError), self._parent(path) as (parent, name):
                    sizes[path] = self._status(path, parent, name).st_size
        return sizes

    def read(self, path: str, size: int) -> bytes:
        """Return the first bytes of a file.

        Parameters
        ----------
        path : str
            Path of the file on the drive.
        size : int
            Largest number of bytes to return.

        Returns
        -------
        bytes
        """
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

        Parameters
        ----------
        path : str
            Path of the file on the drive. Missing folders are created.
        data : bytes
            Content of the file.
        """
        with self._explained(), self._parent(path, make=True) as (parent, name):
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
        with self._explained(), self._parent(path) as (parent, name):
            self._status(path, parent, name)
            os.unlink(name, dir_fd=parent)
            settle(parent)

    def rename(self, path: str, new: str) -> None:
        """Rename a file in its folder.

        Parameters
        ----------
        path : str
            Path of the file.
        new : str
            New path, in the same folder. No file may have this path.
        """
        with self._explained(), self._parent(path) as (parent, name):
            self._status(path, parent, name)
            renamed = name[: len(name) - len(path.split("/")[-1])] + new.split("/")[-1]
            os.rename(name, renamed, src_dir_fd=parent, dst_dir_fd=parent)
            settle(parent)

    def remove_folder(self, path: str) -> None:
        """Remove a folder if it is empty."""
        with contextlib.suppress(OSError), self._parent(path) as (parent, name):
            os.rmdir(name, dir_fd=parent)

    @contextlib.contextmanager
    def _open(self, path: str) -> Iterator[BinaryIO]:
        """Open a file for reading."""
        with self._explained(), self._parent(path) as (parent, name):
            self._status(path, parent, name)
            handle = self._handle(path, name, _READ, parent)
            with os.fdopen(handle, "rb") as file:
                self._check(path, stat.S_ISREG, os.fstat(handle))
                yield file

    @contextlib.contextmanager
    def _parent(self, path: str, make: bool = False) -> Iterator[tuple[int | None, str]]:
        """Yield the descriptor of the folder that contains the file `path`, and the file's name.

        On Windows, the descriptor is None, and the name is the whole path. If `make` is true, a
        missing folder is created.
        """
        *folders, name = path.split("/")
        handle, prefix = (os.dup(self._root), "") if _BY_HANDLE else (None, f"{self.port}/")
        try:
            for i, folder in enumerate(folders, 1):
                so_far = "/".join(folders[:i])
                if make:
                    with contextlib.suppress(FileExistsError):
                        os.mkdir(prefix + folder, dir_fd=handle)
                if handle is None:
                    prefix += f"{folder}/"
                    status = os.lstat(prefix[:-1])
                else:
                    inner = self._handle(so_far, folder, _FOLDER, handle)
                    os.close(handle)
                    handle = inner
                    status = os.fstat(handle)
                self._check(so_far, stat.S_ISDIR, status)
            yield handle, prefix + name
        finally:
            if handle is not None:
                os.close(handle)

    def _handle(self, path: str, name: str, flags: int, parent: int | None) -> int:
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
        # Junctions on Windows and mounts on other systems also lead out of the folder.
        leads_away = getattr(status, "st_file_attributes", 0) & stat.FILE_ATTRIBUTE_REPARSE_POINT
        mounted = self._device not in (None, status.st_dev)
        if leads_away or mounted or not is_kind(status.st_mode):
            self._refuse(path)

    def _refuse(self, path: str) -> None:
        raise SpotsError(
            f"{path} on {self.port} is not the plain file or folder that belongs there, but for "
            f"example a symbolic link: remove {path} from {self.port}, or choose another drive"
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
            raise SpotsError(f"the drive {self.port} {what}") from None


def settle(folder: int | None) -> None:
    """Wait until the disk has stored all changes of the folder whose descriptor is `folder`.

    If `folder` is None, do nothing: on Windows, folders have no descriptors.
    """
    if folder is not None:  # Windows does not delay writes to a removable drive
        os.fsync(folder)
