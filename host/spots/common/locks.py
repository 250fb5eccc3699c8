"""Locks between programs, by the operating system: a killed owner leaves no lock."""

import errno
import os
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

from ..errors import InUseError

_RETRY_S = 0.02
# What the operating system reports if another open file has the lock.
_HELD = {errno.EAGAIN, errno.EACCES, errno.EDEADLK, errno.EWOULDBLOCK}

if sys.platform == "win32":
    import msvcrt

    def _lock(handle: int) -> None:
        # Other handles cannot access the locked byte, so it is beyond the content of all our files.
        os.lseek(handle, 1 << 30, os.SEEK_SET)
        try:
            msvcrt.locking(handle, msvcrt.LK_NBLCK, 1)
        finally:
            os.lseek(handle, 0, os.SEEK_SET)
else:
    import fcntl

    def _lock(handle: int) -> None:
        fcntl.flock(handle, fcntl.LOCK_EX | fcntl.LOCK_NB)


def lock(handle: int) -> bool:
    """Lock an open file until it is closed; return False if another open file has the lock.

    The file must be at its start. OSError if the file system has no locks.
    """
    try:
        _lock(handle)
    except OSError as error:
        if error.errno in _HELD:
            return False
        raise
    return True


@contextmanager
def held(path: Path, wait_s: float = 0.0) -> Iterator[None]:
    """Hold the lock of a file's name, so that no other program of this package changes the file.

    The lock is on an empty file ``.NAME.lock`` in the same folder, which is removed on exit. So the
    lock survives if the file itself is replaced or removed; the file need not exist. InUseError if
    another program holds the lock for longer than `wait_s`; OSError if the folder cannot be
    written.
    """
    real = path.resolve()
    beside = real.with_name(f".{real.name}.lock")
    end_s = time.monotonic() + wait_s
    while (handle := _locked(beside)) is None:
        if time.monotonic() >= end_s:
            raise InUseError(
                f"{path} is in use by another program: end that program, or name another file",
                path,
            )
        time.sleep(_RETRY_S)
    try:
        yield
    finally:
        # POSIX: removed first, so that nobody locks a file that is about to be removed. Windows
        # cannot remove an open file.
        if sys.platform != "win32":
            beside.unlink(missing_ok=True)
        os.close(handle)
        if sys.platform == "win32":
            with suppress(OSError):  # another program has opened it already
                beside.unlink()


def _locked(beside: Path) -> int | None:
    """Open and lock a lock file; return its descriptor, or None if it is in use."""
    handle = os.open(beside, os.O_RDWR | os.O_CREAT | getattr(os, "O_NOFOLLOW", 0), 0o666)
    try:
        free = lock(handle)
    except OSError:
        free = True  # a file system without locks
    with suppress(FileNotFoundError):
        # The holder before may have removed the file after it was opened here.
        if free and os.path.samestat(os.fstat(handle), os.stat(beside)):
            return handle
    os.close(handle)
    return None
