"""A file to append to, which is flushed to the disk every second."""

import errno
import os
import threading
from pathlib import Path

from ..common.atomic import exists, not_written
from ..common.guarded import Guarded
from ..errors import FileError

_SYNC_EVERY_S = 1.0
_NO_SYNC = errno.EINVAL, errno.ENOSYS, errno.ENOTSUP  # of file systems that cannot flush a file


class Disk:
    """A new file to append to; no appended byte waits in the program's memory.

    If the process is killed, no appended byte is lost. A separate thread flushes the file to the
    disk every second, so a power cut loses about the last second. `append` does not wait for this;
    if it fails, for example because of a quota, the next `append` or `close` reports it. FileError
    if the file exists, or cannot be created.
    """

    def __init__(self, path: Path):
        self.path = path
        self.bytes = 0
        try:
            self._file = open(path, "xb", buffering=0)
        except FileExistsError:
            raise exists(path) from None
        except OSError as error:
            raise not_written(path, error) from None
        self._synced = 0
        self._not_synced: OSError | None = None  # until it is reported
        self._closing = threading.Event()
        self._syncer = threading.Thread(target=self._sync, daemon=True)
        self._syncer.start()

    def append(self, data: bytes) -> None:
        """Append bytes; raise FileError if the write fails, for example because the disk is full.

        Earlier bytes stay in the file.
        """
        self._report()
        view = memoryview(data)
        try:
            while view:
                written = self._file.write(view)
                self.bytes += written
                view = view[written:]
        except OSError as error:
            raise FileError(
                f"{self.path}: the recording ended, because nothing more can be written "
                f"({error.strerror}); the file has everything before: make room and record again",
                self.path,
            ) from None

    def close(self) -> None:
        """Flush the file to the disk, and close it; raise SpotsError if this failed."""
        self._closing.set()
        self._syncer.join()
        self._file.close()
        self._report()

    def _report(self) -> None:
        error, self._not_synced = self._not_synced, None
        if error is not None:
            raise FileError(
                f"{self.path}: the recording ended, because the disk does not store it "
                f"({error.strerror}); its last seconds may be missing: check the disk, and record "
                "again on another one",
                self.path,
            )

    def _sync(self) -> None:
        flush = Guarded(self._flush, f"writing {self.path} to the disk")
        while not self._closing.wait(_SYNC_EVERY_S):
            flush()
        flush()

    def _flush(self) -> None:
        written = self.bytes
        if self._synced == written:
            return
        self._synced = written
        try:
            os.fsync(self._file.fileno())
        except OSError as error:
            if error.errno not in _NO_SYNC:
                self._not_synced = error
