"""Locks between programs, by the operating system: a killed owner leaves no lock."""

import errno
import sys
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

from filelock import FileLock, Timeout, lock_descriptor

from ..errors import InUseError

_RETRY_S = 0.02
# What the operating system reports for a file system without locks.
_NO_LOCKS = {errno.ENOSYS, errno.ENOLCK, errno.EOPNOTSUPP}


def lock(handle: int) -> bool:
    """Lock an open file until it is closed; return False if another open file has the lock.

    OSError if the file system has no locks.
    """
    return lock_descriptor(handle, blocking=False)


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
    # Any thread may leave the block. A soft lock would outlive its owner.
    named = FileLock(beside, wait_s, thread_local=False, fallback_to_soft=False)
    try:
        real.parent.stat()  # `FileLock` would make a missing folder
        named.acquire(poll_interval=_RETRY_S)
    except Timeout:
        raise InUseError(
            f"{path} is in use by another program: end that program, or name another file", path
        ) from None
    except OSError as error:
        if error.errno not in _NO_LOCKS:
            raise
    try:
        yield
    finally:
        # POSIX: removed first, so that nobody locks a file that is about to be removed. On Windows,
        # which cannot remove an open file, `release` does it.
        if sys.platform != "win32":
            with suppress(FileNotFoundError):
                beside.unlink()
        named.release()
