"""Writes the bytes of a link to files, while a program reads from the link."""

import re
import secrets
import threading
import time
from collections.abc import Callable
from contextlib import AbstractContextManager, suppress
from pathlib import Path

import msgspec

from spots_device import __version__

from ..common.atomic import exists
from ..errors import SettingError, SpotsError, path_text
from ..link.decoder import note, whole
from .disk import Disk
from .header import VERSION, Header, encoded

# Data that arrives within this time, in s, shares one note of the arrival time. A shorter step is
# more precise and takes more bytes.
ARRIVAL_STEP_S = 0.005


class Writer(AbstractContextManager):
    """Writes the frames of a link to files, and notes about time and clocks between the frames.

    The format is in docs/program/recording-format.md. ``now_s()`` is the time of the link's clock.
    ``describe()`` returns a dict with the present ``info``, ``clock``, ``calibration``,
    ``restarts`` and ``sequence`` for a `header.Header`. `begun` are bytes of an incomplete frame
    that arrived before the recording began. Beyond about `rotate_bytes`, FILE.spots continues in
    FILE-001.spots, FILE-002.spots, ...; none of these may exist yet. FileError if a file already
    exists or cannot be written.

    ``on_error(error)`` is called if nothing more can be written, instead of an exception from
    `take`, which would end the program's reading from the link.
    """

    def __init__(
        self,
        now_s: Callable[[], float],
        path: str | Path,
        describe: Callable[[], dict],
        *,
        begun: bytes = b"",
        rotate_bytes: int | None = None,
        utc_s: Callable[[], float] = lambda: time.time(),
    ):
        self._now_s = now_s
        self._path = Path(path_text(path, "the path of a recording"))
        self._describe = describe
        if rotate_bytes is not None and not (
            isinstance(rotate_bytes, (int, float)) and rotate_bytes > 0
        ):
            raise SettingError(f"rotate_bytes must be more than 0, not {rotate_bytes!r}")
        self._rotate_bytes = rotate_bytes
        self._utc_s = utc_s
        self._set = secrets.token_hex(8)
        self._tail = begun
        self._marks = b""  # notes that wait for the end of a frame
        self._between_frames = True
        self._disk: Disk | None = None
        self._lock = threading.RLock()  # after Ctrl-C, this thread may still hold it
        self.paths: list[Path] = []
        self.bytes = 0
        self.on_error: Callable[[SpotsError], None] | None = None
        if rotate_bytes is not None and (parts := parts_beside(self._path)):
            # Report an existing file now, and not hours later when the first file is full.
            raise exists(part_path(self._path, parts[0]))
        self._begin()

    def __exit__(self, *exception) -> None:
        self.stop()

    def take(self, data: bytes, now_s: float) -> None:
        """Record bytes that arrived at a time of the link's clock; ignored after the end.

        FileError if nothing more can be written, and `on_error` is None. The recording then ends.

        Parameters
        ----------
        data : bytes
            The bytes.
        now_s : float
            The time in seconds.
        """
        with self._lock:
            if data and self._disk is not None:
                try:
                    self._keep(data, now_s)
                except Exception as error:  # not a Ctrl-C, after which `stop` can write the end
                    with suppress(SpotsError):  # the first error is enough
                        self._release()
                    if self.on_error is None or not isinstance(error, SpotsError):
                        raise
                    self.on_error(error)

    def mark(self, text: str) -> None:
        """Write a mark of the present moment; ignored after the end of the recording."""
        with self._lock:
            if self._disk is None:
                return
            note = self._note({"mark": text})
            if self._between_frames:
                self._append(note)
            else:
                self._marks += note

    def stop(self) -> None:
        """End the recording. Idempotent, and safe while another thread reads from the link.

        FileError if the end of the recording cannot be written.
        """
        with self._lock:
            if self._disk is None:
                return
            try:
                # Within a partial frame, the note would be lost. So a delimiter ends such a frame.
                ended = b"" if self._between_frames else b"\0"
                self._append(
                    ended + self._marks + self._note({"end": True, "utc_s": self._utc_s()})
                )
            finally:
                self._release()

    def _keep(self, data: bytes, now_s: float) -> None:
        self._tail += data
        size = whole(self._tail)
        if not size:
            return
        piece, self._tail = self._tail[:size], self._tail[size:]
        if self._between_frames:
            size += self._disk.bytes
            full = self._rotate_bytes is not None and size > self._rotate_bytes
            if full and self._disk.bytes > self._header_bytes:
                before = self._disk
                self._begin()
                before.close()
            if now_s >= self._next_note_s:
                self._next_note_s = now_s + ARRIVAL_STEP_S
                piece = self._note() + piece
            now = self._describe()
            if _bounds(now["clock"]) != self._bounds:
                # The map from board time to host time changes before these frames.
                self._bounds = _bounds(now["clock"])
                known = {"clock": now["clock"], "restarts": now["restarts"]}
                piece = self._note({**known, "utc_s": self._utc_s()}) + piece
            piece, self._marks = self._marks + piece, b""
        self._between_frames = False  # until the write is complete: Ctrl-C may interrupt it
        self._append(piece)
        self._between_frames = piece.endswith(b"\0")

    def _begin(self) -> None:
        part = len(self.paths)
        begun_s = self._now_s()
        header = {
            "recording": VERSION,
            "program": "spots " + __version__,
            "set": self._set,
            "part": part,
            "host_s": begun_s,
            "utc_s": self._utc_s(),
            **self._describe(),
        }
        data = encoded(msgspec.convert(header, Header))  # an invalid header makes no file
        disk = Disk(part_path(self._path, part))
        self.paths.append(disk.path)
        try:
            disk.append(data)
        except BaseException:
            disk.close()
            raise
        self.bytes += disk.bytes
        self._header_bytes = disk.bytes
        self._bounds = _bounds(header["clock"])
        self._begun_s = self._next_note_s = begun_s
        self._disk = disk

    def _note(self, content: dict | None = None) -> bytes:
        return note(int(1e6 * (self._now_s() - self._begun_s)), content)

    def _append(self, data: bytes) -> None:
        self.bytes += len(data)
        self._disk.append(data)

    def _release(self) -> None:
        disk, self._disk = self._disk, None
        if disk is not None:
            disk.close()


def _bounds(clock: dict) -> tuple:
    return tuple(value for name, value in clock.items() if name != "last_us")


def part_path(path: Path, part: int) -> Path:
    """Return the path of one of a recording's files: FILE.spots, FILE-001.spots, ..."""
    return path if part == 0 else path.with_name(f"{path.stem}-{part:03d}{path.suffix}")


def parts_beside(path: Path) -> list[int]:
    """Return the numbers of existing files named as later parts, such as 1 for FILE-001.spots."""
    number = r"-((?!000)\d{3}|[1-9]\d{3,})"
    name = re.compile(re.escape(path.stem) + number + re.escape(path.suffix))
    beside = (name.fullmatch(file.name) for file in path.parent.glob("*"))
    return sorted(int(match[1]) for match in beside if match)
