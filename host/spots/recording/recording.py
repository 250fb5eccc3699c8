"""From a recording, or the files of a set, to frames and when they arrived."""

from __future__ import annotations

from collections.abc import Iterator
from itertools import chain
from pathlib import Path

import msgspec

from ..bounded import open_regular
from ..errors import SpotsError
from ..link.clockmap import ClockMap
from ..link.frames import Decoder, Frame, LinkStats, Note
from .header import Clock, Header, read
from .recorder import part_path, parts_beside

# Statistics are ahead of the frames by at most so much: small, and yet little work a frame.
_BLOCK_BYTES = 512


class Recording:
    """A recording; iterate over it to read it, as often as one likes.

    Iteration gives pairs of when a frame arrived on the host's monotonic clock (it was read then or
    up to `recorder.ARRIVAL_STEP_S` later) and the frame, with the ``time_s`` that it had when it
    was received.

    Parameters
    ----------
    path : str or Path
        With the first file of a set come the others. A later one stands for itself.

    Attributes
    ----------
    path : Path
    paths : list of Path
        The files.
    header : Header
        Of the first one.
    size : int
        Bytes of all files when they were opened.
    stats : LinkStats
        Of the latest iteration, so far: what the recorded link lost.
    notes : int
        How many notes it met.
    restarts : int
        How often the board restarted meanwhile.
    cut_bytes : int
        Bytes of frames that the files end in the middle of.
    read_bytes : int
        How far it is.
    end_s : float
        When the last frame or note was written, on the clock of the times of arrival.
    complete : bool
        Whether it came to the note that a recorder ends with.

    Raises
    ------
    SpotsError
        If it is no recording, or a file of the set is missing.

    Examples
    --------
    >>> from spots import Recording
    >>> recording = Recording("run.spots")
    >>> sum(isinstance(frame, spots.Touch) for arrived_s, frame in recording)
    301
    """

    def __init__(self, path: str | Path):
        self.path = Path(path)
        self.header = _header(self.path)
        self._headers = {self.path: self.header, **_others(self.path, self.header)}
        self.paths = list(self._headers)
        self.size = sum(path.stat().st_size for path in self.paths)
        self._decoder = Decoder()
        self._restart()

    def __iter__(self) -> Iterator[tuple[float, Frame]]:
        for path, header, block in self._blocks(_BLOCK_BYTES):
            for frame in self._decoder.feed(block):
                if isinstance(frame, Note):
                    self._note(path, header, frame)
                else:
                    yield self.end_s, self._clock.timed(frame, self.end_s)

    def _blocks(self, size: int) -> Iterator[tuple[Path, Header, bytes]]:
        """Yield the bytes of the files in turn, with what was known when each of them began."""
        self._restart()
        start = b""
        for path, header in self._headers.items():
            self._clock = _resumed(header.clock)
            self._decoder.restarted(header.restarts)
            self.end_s = header.host_s
            for block in chain([start], _blocks(path, size)):
                self.read_bytes += len(block)
                yield path, header, block
            self.cut_bytes += len(self._decoder.pending)
            start = b"\0"  # what a file breaks off in the middle of does not go on in the next

    def _note(self, path: Path, header: Header, note: Note) -> None:
        self.notes += 1
        self.end_s = header.host_s + 1e-6 * note.since_us
        if "clock" in note.content:
            self._clock = _noted(path, note.content["clock"])
        self.complete |= note.content.get("end") is True

    @property
    def stats(self) -> LinkStats:
        return self._decoder.stats

    @property
    def restarts(self) -> int:
        return max(0, self._decoder.restarts - self.header.restarts)

    def _restart(self) -> None:
        self._decoder = Decoder()
        self.notes = self.cut_bytes = self.read_bytes = 0
        self.end_s = self.header.host_s
        self.complete = False


def _resumed(known: Clock) -> ClockMap:
    return ClockMap.resume(**msgspec.structs.asdict(known))


def _noted(path: Path, content: object) -> ClockMap:
    try:
        return _resumed(msgspec.convert(content, Clock))
    except msgspec.ValidationError as error:
        raise SpotsError(f"{path}: a note is invalid: {error}") from None


def _header(path: Path) -> Header:
    return read(path, _blocks(path))


def _others(path: Path, first: Header) -> dict[Path, Header]:
    """Return the later files of a set with their headers, if `path` is its first."""
    if first.part != 0:
        return {}
    found = {}
    for part in parts_beside(path):
        file = part_path(path, part)
        try:
            header = _header(file)
        except SpotsError:
            continue  # not a recording, so not a part of this set
        if header.set == first.set:
            found[part] = (file, header)
    for part in range(1, max(found, default=0)):
        if part not in found:
            raise SpotsError(
                f"{part_path(path, part)} is missing or damaged: name the files of the set one by "
                "one, or put it back"
            )
    return dict(found.values())


def _blocks(path: Path, size: int = _BLOCK_BYTES) -> Iterator[bytes]:
    try:
        with open_regular(path) as file:
            while block := file.read(size):
                yield block
    except FileNotFoundError:
        raise SpotsError(f"there is no file {path}: 'spots record' makes recordings") from None
    except IsADirectoryError:
        raise SpotsError(f"{path} is a directory: name a recording in it") from None
    except OSError as error:
        raise SpotsError(f"{path} cannot be read: {error.strerror}") from None
