"""Atomic writes of files: a reader sees the old content or the new content, never a part.

A file is written under a random name in the same folder, and renamed when it is complete. The
random name is created exclusively, so no link is followed. `folder` makes a staging directory: a
caller completes a new folder in it, then moves the new folder to its final path. If the process is
killed, temporary files and directories remain. When they are more than an hour old, the next
`replacing` in the same folder removes the files, and the next `folder` the directories. A living
process locks what it writes, so its files remain however old they are, or seem when the clock is
set.
"""

import errno
import os
import re
import secrets
import shutil
import stat
import tempfile
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import IO

from . import locks
from .bounded import open_regular
from .errors import SpotsError

_PREFIX, _SUFFIX = ".spots-", ".part"
_PART = re.compile(r"\.spots-\w{8,16}\.part")
_LOCK = "lock"  # file in a staging directory that its process locks
# A process locks a temporary file just after its creation, and some file systems have no locks.
_STALE_S = 3600.0
_LOCK_S = 1.0  # longest wait for another program that replaces the same file


class ChangedError(SpotsError):
    """Raised if a file that should be replaced was changed by another program."""


@contextmanager
def replacing(
    path: str | Path,
    kind: str = "b",
    *,
    new: bool = False,
    was: bytes | None = None,
    **options,
) -> Iterator[IO]:
    """Create or replace a file atomically, when a ``with`` block ends without an exception.

    A symbolic link with this name is replaced and not followed. The permissions of a replaced file
    are kept.

    Parameters
    ----------
    path : str or Path
        Name of the file.
    kind : str
        ``b`` for a binary file, ``t`` for text.
    new : bool
        Whether an existing file is an error.
    was : bytes, optional
        Content that the existing file must still have; the file may also be missing.
    **options
        Further options of `open`, such as ``encoding``.

    Yields
    ------
    file object
        The open file, to write to.

    Raises
    ------
    SpotsError
        If the file cannot be written, or `new` is true and it exists. An existing file is
        unchanged.
    ChangedError
        If the content of the file is not `was`. The file is unchanged.
    """
    path = Path(path)
    part = path.parent / f"{_PREFIX}{secrets.token_hex(8)}{_SUFFIX}"
    try:
        mode = _replaced_mode(path, new)
        # A replacement of a private file is private from its first byte on.
        access = 0o666 if mode is None else 0o600
        _sweep(path.parent, os.DirEntry.is_file, os.unlink)
        with open(
            part, "x" + kind, opener=lambda path, flags: os.open(path, flags, access), **options
        ) as file:
            _mark(file.fileno())
            yield file
            sync(file)
        if mode is not None and stat.S_IMODE(part.stat().st_mode) != mode:
            part.chmod(mode)
        if was is None:
            (_place_new if new else os.replace)(part, path)
        else:
            _replace_unchanged(part, path, was)
    except OSError as error:
        raise not_written(path, error) from None
    finally:
        with suppress(OSError):
            part.unlink(missing_ok=True)


def write_text(text: str, path: str | Path) -> None:
    """Create or replace a text file atomically.

    Parameters
    ----------
    text : str
        Content of the file. Line ends are written unchanged.
    path : str or Path
        Name of the file. A symbolic link with this name is replaced and not followed.

    Raises
    ------
    SpotsError
        If the file cannot be written. An existing file is unchanged.
    """
    with replacing(path, "t", encoding="utf-8", newline="\n") as file:
        file.write(text)


def sync(file: IO) -> None:
    """Wait until everything written to a file is on the storage medium, or raise OSError."""
    file.flush()
    os.fsync(file.fileno())


@contextmanager
def folder(parent: Path) -> Iterator[Path]:
    """Make a staging directory in the folder `parent`, and remove the directory on exit.

    A caller completes a new folder in this directory, then moves the new folder to its final path.

    Raises
    ------
    OSError
        If the directory cannot be created.
    """
    _sweep(parent, os.DirEntry.is_dir, shutil.rmtree)
    with (
        tempfile.TemporaryDirectory(
            _SUFFIX, _PREFIX, parent, ignore_cleanup_errors=True
        ) as staging,
        open(Path(staging, _LOCK), "xb") as file,
    ):
        _mark(file.fileno())
        yield Path(staging)


def not_written(path: Path, error: OSError) -> SpotsError:
    """Return the error for a file that cannot be written.

    Parameters
    ----------
    path : Path
        Name of the file.
    error : OSError
        The reason.

    Returns
    -------
    SpotsError
    """
    if not path.parent.is_dir():
        return SpotsError(f"there is no folder {path.parent}: make it first")
    reason = error.strerror or error
    return SpotsError(f"cannot write {path}: {reason}; name another file or folder")


def check_writable(path: Path, append: bool = False) -> None:
    """Check that a file can be created or replaced, before work whose result goes into the file.

    Parameters
    ----------
    path : Path
        Name of the file. File and folder are unchanged.
    append : bool
        Whether the file will be appended to instead of replaced.

    Raises
    ------
    SpotsError
        If the file cannot be written.
    """
    try:
        if _replaced_mode(path, new=False) is not None and append:
            open(path, "ab").close()
            return
        with tempfile.NamedTemporaryFile(prefix=_PREFIX, suffix=_SUFFIX, dir=path.parent):
            pass
    except OSError as error:
        raise not_written(path, error) from None


def exists(path: Path) -> SpotsError:
    """Return the error for a file that must be new but exists."""
    return SpotsError(f"{path} exists: choose another name or remove it")


def _place_new(part: Path, path: Path) -> None:
    """Rename the complete file `part` to `path`; raise SpotsError if `path` exists."""
    try:
        os.link(part, path)
    except OSError:  # also on a file system without hard links
        if os.path.lexists(path):
            raise exists(path) from None
        os.replace(part, path)


def _replace_unchanged(part: Path, path: Path, was: bytes) -> None:
    """Rename the complete file `part` to `path`, if the file there has the content `was`.

    A second program of this package that replaces the file waits, so that neither of them loses
    what the other one writes.
    """
    with locks.held(path, _LOCK_S):
        if not has_content(path, was):
            raise ChangedError(f"another program has changed {path}: nothing was written")
        os.replace(part, path)


def has_content(path: Path, content: bytes) -> bool:
    """Return whether a file has a content, or is missing.

    Parameters
    ----------
    path : Path
        Name of the file.
    content : bytes
        The content.

    Returns
    -------
    bool
        False also for something that is not a readable file.
    """
    try:
        with open_regular(path) as file:
            return file.read(len(content) + 1) == content
    except FileNotFoundError:
        return True
    except (OSError, SpotsError):
        return False


def _replaced_mode(path: Path, new: bool) -> int | None:
    """Return the permissions of the file at `path`, or None if there is no file.

    A folder, a pipe or a device at `path` is always an error; a file is an error if `new` is true.
    """
    if new and os.path.lexists(path):
        raise exists(path)
    try:
        mode = path.stat().st_mode
    except FileNotFoundError:
        return None
    if stat.S_ISDIR(mode):
        raise IsADirectoryError(errno.EISDIR, os.strerror(errno.EISDIR))
    if not stat.S_ISREG(mode):
        raise OSError(errno.EINVAL, "it is not a regular file")
    return mode & 0o777


def _sweep(parent: Path, is_kind: Callable[..., bool], remove: Callable[[str], None]) -> None:
    """Remove temporary files or folders that killed processes left more than an hour ago.

    Parameters
    ----------
    parent : Path
        Folder to search.
    is_kind : callable
        ``is_kind(entry, follow_symlinks=False)`` tests whether an `os.DirEntry` is a file, or is
        a folder.
    remove : callable
        ``remove(path)`` removes a file or a folder.
    """
    with suppress(OSError), os.scandir(parent) as entries:
        for entry in entries:
            if _PART.fullmatch(entry.name) and is_kind(entry, follow_symlinks=False):
                with suppress(OSError):
                    changed_s = entry.stat(follow_symlinks=False).st_mtime
                    if time.time() - changed_s > _STALE_S and not _in_use(Path(entry.path)):
                        remove(entry.path)


def _mark(handle: int) -> None:
    """Mark a new open file as in use by this process, for `_in_use`."""
    with suppress(OSError):  # a file system without locks, where `_sweep` removes nothing
        locks.lock(handle)


def _in_use(path: Path) -> bool:
    """Return whether a living process, such as this one, writes a temporary file or directory."""
    try:
        handle = os.open(path / _LOCK if path.is_dir() else path, os.O_RDWR)
    except FileNotFoundError:
        return False  # killed before `_mark`
    try:
        return not locks.lock(handle)
    finally:
        os.close(handle)
