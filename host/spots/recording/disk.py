"""A file that only grows."""

from __future__ import annotations

import os
import threading
from pathlib import Path

from ..errors import SpotsError
from ..guarded import Guarded

_SYNC_EVERY_S = 1.0


class Disk:
    """A new file whose bytes are the operating system's at once and the medium's soon.

    A kill of the process loses nothing that was appended; a cut of power no more than what came in
    the last second and while the medium was being written. Waiting for it is a thread's work.

    Parameters
    ----------
    path : Path
        A file that is not there yet.

    Raises
    ------
    SpotsError
        If it is, or cannot be made.
    """

    def __init__(self, path: Path):
        self.path = path
        self.bytes = 0
        try:
            self._file = open(path, "xb", buffering=0)
        except FileExistsError:
            raise SpotsError(f"{path} exists: choose another name or remove it") from None
        except FileNotFoundError:
            raise SpotsError(f"there is no folder {path.parent}: make it first") from None
        except OSError as error:
            raise SpotsError(f"{path} cannot be written: {error.strerror}") from None
        self._synced = 0
        self._closing = threading.Event()
        self._syncer = threading.Thread(target=self._sync, daemon=True)
        self._syncer.start()

    def append(self, data: bytes) -> None:
        """Append bytes. Raises SpotsError if the medium is full; what was appended stays."""
        view = memoryview(data)
        try:
            while view:
                written = self._file.write(view)
                self.bytes += written
                view = view[written:]
        except OSError as error:
            raise SpotsError(
                f"{self.path}: the recording ended, nothing more can be written: {error.strerror}"
            ) from None

    def close(self) -> None:
        """Return when all is on the medium."""
        self._closing.set()
        self._syncer.join()
        self._file.close()

    def _sync(self) -> None:
        flush = Guarded(self._flush, f"writing {self.path} to its medium")
        while not self._closing.wait(_SYNC_EVERY_S):
            flush()
        flush()

    def _flush(self) -> None:
        written = self.bytes
        if self._synced != written:
            try:
                os.fsync(self._file.fileno())
            except OSError:
                pass  # a pipe, or a removed medium: `append` reports it
            self._synced = written
