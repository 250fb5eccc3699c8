"""Files and folders written atomically: others see the old one or the new one, and each is whole.

Until it is whole, a file has a random name in the same folder. It is created exclusively, so no
link is followed. A killed process leaves it behind; the next write in that folder removes it. A
lock on it, which ends with its process, shows whether it is still being written.
"""

from __future__ import annotations

import errno
import os
import re
import secrets
import shutil
import stat
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import IO

from .errors import SpotsError

try:
    import fcntl
except ImportError:  # Windows
    fcntl = None

_NAME = ".spots-{}.part"
_OURS = re.compile(r"\.spots-[0-9a-f]{16}\.part")
_TRIES = 100
# Where there are no locks, a left-over is one that nobody has touched for so long.
_STALE_S = 3600.0


class _SweptError(Exception):
    pass


@contextmanager
def replacing(path: str | Path, kind: str = "b", *, new: bool = False, **options) -> Iterator[IO]:
    """Write a file, or replace it, at the end of the context; nothing changes on an exception.

    A link in its place is replaced and not followed. A replaced file's mode is kept.

    Parameters
    ----------
    path : str or Path
    kind : str
        ``b`` for a binary file, ``t`` for text.
    new : bool
        Whether to refuse to replace a file.
    **options
        See `open`.

    Yields
    ------
    file object
        To be written. What is flushed and synced is not yet under its name.

    Raises
    ------
    SpotsError
        If it cannot be written; then what was there still is.
    """
    path = Path(path)
    beside = lock = None
    try:
        mode = _replaced_mode(path, new)
        _sweep(path.parent, stat.S_ISREG, os.unlink)
        beside, file, lock = _create(path.parent, kind, mode, options)
        with file:
            yield file
            sync(file)
        if mode is not None and stat.S_IMODE(beside.stat().st_mode) != mode:
            beside.chmod(mode)
        (_place_new if new else os.replace)(beside, path)
    except OSError as error:
        if not path.parent.is_dir():
            raise SpotsError(f"there is no folder {path.parent}: make it first") from None
        raise SpotsError(f"cannot write {path}: {error.strerror or error}") from None
    finally:
        if beside is not None:
            with suppress(OSError):
                beside.unlink(missing_ok=True)
        _release(lock)


def write_text(text: str, path: str | Path) -> None:
    """Write a text file, or replace it.

    Parameters
    ----------
    text : str
        The whole content; line ends are written as they are.
    path : str or Path
        A link there is replaced and not followed.

    Raises
    ------
    SpotsError
        If it cannot be written; then what was there still is.
    """
    with replacing(path, "t", encoding="utf-8", newline="\n") as file:
        file.write(text)


def sync(file: IO) -> None:
    """Return when all that was written is on the medium; raises OSError if it cannot be."""
    file.flush()
    os.fsync(file.fileno())


@contextmanager
def folder(parent: Path) -> Iterator[Path]:
    """Make a staging directory in a folder; it is removed on exit.

    Raises
    ------
    OSError
        If it cannot be made.
    """
    _sweep(parent, stat.S_ISDIR, shutil.rmtree)
    for _ in range(_TRIES):
        path = parent / _NAME.format(secrets.token_hex(8))
        path.mkdir(0o700)
        with suppress(_SweptError):
            lock = _locked(path)
            break
    else:
        raise OSError(errno.EBUSY, os.strerror(errno.EBUSY))
    try:
        yield path
    finally:
        shutil.rmtree(path, ignore_errors=True)
        _release(lock)


def _place_new(beside: Path, path: Path) -> None:
    """Give a file its name, unless there is one meanwhile."""
    try:
        os.link(beside, path)
    except FileExistsError:
        raise _exists(path) from None
    except OSError:  # a file system without links
        if os.path.lexists(path):
            raise _exists(path) from None
        os.replace(beside, path)


def _exists(path: Path) -> SpotsError:
    return SpotsError(f"{path} exists: choose another name or remove it")


def _replaced_mode(path: Path, new: bool) -> int | None:
    """Return the mode of the file that is replaced, if there is one."""
    if new and os.path.lexists(path):
        raise _exists(path)
    try:
        mode = path.stat().st_mode
    except FileNotFoundError:
        return None
    if stat.S_ISDIR(mode):
        raise IsADirectoryError(errno.EISDIR, os.strerror(errno.EISDIR))
    if not stat.S_ISREG(mode):
        raise OSError(errno.EINVAL, "it is not a regular file")
    return mode & 0o777


def _create(
    parent: Path, kind: str, mode: int | None, options: dict
) -> tuple[Path, IO, int | None]:
    # What replaces a private file is private from its first byte on.
    access = 0o666 if mode is None else 0o600
    for _ in range(_TRIES):
        beside = parent / _NAME.format(secrets.token_hex(8))
        file = open(
            beside, "x" + kind, opener=lambda path, flags: os.open(path, flags, access), **options
        )
        try:
            return beside, file, _locked(beside)
        except _SweptError:
            file.close()
    raise OSError(errno.EBUSY, os.strerror(errno.EBUSY))


def _sweep(parent: Path, is_kind: Callable[[int], bool], remove: Callable[[str], None]) -> None:
    """Remove what processes left behind that were killed while they wrote in a folder."""
    with suppress(OSError), os.scandir(parent) as entries:
        for entry in entries:
            if _OURS.fullmatch(entry.name):
                with suppress(OSError):
                    known = entry.stat(follow_symlinks=False)
                    if is_kind(known.st_mode) and _is_own(known):
                        _remove_unlocked(entry.path, known, remove)


def _is_own(known: os.stat_result) -> bool:
    return not hasattr(os, "geteuid") or known.st_uid == os.geteuid()


def _remove_unlocked(path: str, known: os.stat_result, remove: Callable[[str], None]) -> None:
    if fcntl is None:
        if time.time() - known.st_mtime > _STALE_S:
            remove(path)
        return
    lock = os.open(path, os.O_RDONLY | os.O_NOFOLLOW | os.O_NONBLOCK)
    try:
        fcntl.flock(lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
        if os.path.samestat(os.fstat(lock), known):
            remove(path)
    finally:
        os.close(lock)


def _locked(path: Path) -> int | None:
    """Return a descriptor whose lock lasts until it is closed, or its process ends.

    Raises
    ------
    _SweptError
        If another process takes the path for a left-over: it was not locked at once.
    """
    if fcntl is None:
        return None
    try:
        lock = os.open(path, os.O_RDONLY | os.O_NOFOLLOW)
    except FileNotFoundError:
        raise _SweptError from None
    try:
        fcntl.flock(lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
        swept = not path.exists()
    except BlockingIOError:
        swept = True
    except OSError:
        swept = False  # a file system without locks: nobody gets one, and nothing is swept
    if swept:
        os.close(lock)
        raise _SweptError
    return lock


def _release(lock: int | None) -> None:
    if lock is not None:
        os.close(lock)
