"""Records a link while someone else reads from it."""

from __future__ import annotations

import re
import secrets
import time
from collections.abc import Callable
from pathlib import Path

import msgspec

from spots_device import __version__

from ..errors import SpotsError
from ..link.frames import whole
from ..link.serial_link import Link, LinkWrapper
from .disk import Disk
from .header import VERSION, Header, encoded
from .note import note

# What comes within this time shares a note of when. Shorter is more precise and takes more bytes.
ARRIVAL_STEP_S = 0.005


class Recorder(LinkWrapper):
    """A link that writes down what is read through it, before it hands it on.

    It knows of frames only where they end: it writes whole ones, and its own notes between them.

    Parameters
    ----------
    link : serial_link.Link
        The link that is recorded.
    path : str or Path
        A file that is not there yet.
    describe : callable
        Returns the keys ``info``, ``clock``, ``calibration`` and ``restarts`` of a
        `header.Header` as they are now.
    begun : bytes
        The beginning of a frame that has already been read.
    rotate_bytes : int, optional
        Begin another file where one would become longer: FILE-001.spots after FILE.spots. None
        with such a name may be there yet.
    utc_s : callable
        The time since 1970.

    Attributes
    ----------
    paths : list of Path
        The files.
    bytes : int
        Written to all of them.

    Raises
    ------
    SpotsError
        If there is such a file, or it cannot be written.
    """

    def __init__(
        self,
        link: Link,
        path: str | Path,
        describe: Callable[[], dict],
        *,
        begun: bytes = b"",
        rotate_bytes: int | None = None,
        utc_s: Callable[[], float] = time.time,
    ):
        while isinstance(link, Recorder) and link._disk is None:
            link = link._link  # one that has ended is not in the way for ever
        super().__init__(link)
        self._path = Path(path)
        self._describe = describe
        self._rotate_bytes = rotate_bytes
        self._utc_s = utc_s
        self._set = secrets.token_hex(8)
        self._tail = begun
        self._between_frames = True
        self._disk: Disk | None = None
        self.paths: list[Path] = []
        self.bytes = 0
        if rotate_bytes is not None and (there := parts_beside(self._path)):
            # Now, while somebody looks, and not hours later where the first file is full.
            taken = part_path(self._path, there[0])
            raise SpotsError(f"{taken} exists: choose another name or remove it")
        self._begin()

    def __enter__(self) -> Recorder:
        return self

    def __exit__(self, *exception) -> None:
        self.stop()

    def read(self, timeout_s: float) -> bytes:
        """Raises SpotsError also if nothing more can be written."""
        data = self._link.read(timeout_s)
        if data and self._disk is not None:
            try:
                self._keep(data)
            except Exception:  # Ctrl-C, too, comes here; after it the file is fit for an end
                self._release()
                raise
        return data

    def reopen(self) -> None:
        """Raises SpotsError if the port is still away."""
        self._link.reopen()
        if self._disk is not None:
            self._keep(b"\0")  # the frame that was cut off ends here

    def stop(self) -> None:
        """End the recording; the link goes on. Twice is once."""
        if self._disk is None:
            return
        try:
            # A note in the middle of noise would be lost in it.
            self._append((b"" if self._between_frames else b"\0") + self._note({"end": True}))
        finally:
            self._release()

    def close(self) -> None:
        """End the recording and let the port go."""
        try:
            self.stop()
        finally:
            self._link.close()

    def _keep(self, data: bytes) -> None:
        self._tail += data
        size = whole(self._tail)
        if not size:
            return
        piece, self._tail = self._tail[:size], self._tail[size:]
        if self._rotate_bytes is not None and self._between_frames:
            full = self._disk.bytes + len(piece) > self._rotate_bytes
            if full and self._disk.bytes > self._header_bytes:
                before = self._disk
                self._begin()
                before.close()
        now_s = self.now_s()
        if self._between_frames and now_s >= self._next_note_s:
            self._next_note_s = now_s + ARRIVAL_STEP_S
            piece = self._note() + piece
        now = self._describe()
        if self._between_frames and _bounds(now["clock"]) != self._bounds:
            # The clocks were compared again: from here on the board's times are mapped so.
            self._bounds = _bounds(now["clock"])
            piece = self._note({"clock": now["clock"], "restarts": now["restarts"]}) + piece
        self._between_frames = False  # until it is known: Ctrl-C may come before the next line
        self._append(piece)
        self._between_frames = piece.endswith(b"\0")

    def _begin(self) -> None:
        part = len(self.paths)
        begun_s = self.now_s()
        header = {
            "recording": VERSION,
            "program": "spots " + __version__,
            "set": self._set,
            "part": part,
            "host_s": begun_s,
            "utc_s": self._utc_s(),
            **self._describe(),
        }
        data = encoded(msgspec.convert(header, Header))  # one that is refused makes no file
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
        return note(int(1e6 * (self.now_s() - self._begun_s)), content)

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
    """Return the name of a file of a set: FILE.spots, FILE-001.spots, ...

    Parameters
    ----------
    path : Path
        Of the first file.
    part : int
        Number of the file, from 0.

    Returns
    -------
    Path
    """
    return path if part == 0 else path.with_name(f"{path.stem}-{part:03d}{path.suffix}")


def parts_beside(path: Path) -> list[int]:
    """Return the numbers of the later files of a set that are there, by their names."""
    name = re.compile(re.escape(path.stem) + r"-(\d{3}|[1-9]\d{3,})" + re.escape(path.suffix))
    beside = (name.fullmatch(file.name) for file in path.parent.glob("*"))
    return sorted(int(match[1]) for match in beside if match)
