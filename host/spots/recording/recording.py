"""Reads the frames of a recording, which may have several files, and their times of arrival."""

from collections.abc import Iterator
from itertools import chain
from pathlib import Path
from typing import NamedTuple

import msgspec

from ..common import kinds
from ..common.bounded import open_regular
from ..errors import FileError, SpotsError, path_text, printable
from ..link.clockmap import ClockMap
from ..link.decoder import Decoder
from ..link.frames import Frame, LinkStats, Note, Touch, with_sigma
from .header import UTC_MOST_S, Clock, Header, read
from .utc import Seen, Utc
from .writer import part_path, parts_beside

# Statistics may be ahead of the frames by a block; a smaller block means more work per frame.
_BLOCK_BYTES = 512


class Mark(NamedTuple):
    """A moment that a program marked during a recording.

    Attributes
    ----------
    time_s : float
        Its time, in seconds by the host's monotonic clock.
    text : str
        Its text.
    """

    time_s: float
    text: str


class Recording:
    """Reads a recording: iterate over this object, any number of times.

    The iteration yields pairs (time of arrival, frame). The time of arrival is on the host's
    monotonic clock, in seconds. Frames that arrived within 5 ms (`recorder.ARRIVAL_STEP_S`) of each
    other may have the time of the first one. The ``time_s`` of a frame is the same as during the
    recording.

    Parameters
    ----------
    path : str or Path
        File of the recording. If this is the first of several files of one recording, the other
        files are read too.

    Attributes
    ----------
    path : Path
        Path of the given file.
    paths : list of Path
        Paths of all files.
    header : Header
        Header of the first file.
    headers : dict of Path to Header
        Header of each file.
    size : int
        Size of all files when they were opened, in bytes.
    stats : LinkStats
        Statistics of the recorded link. This attribute and those below belong to the present
        iteration: each iteration resets them.
    notes : int
        Number of notes, which the recorder adds between frames.
    restarts : int
        Number of restarts of the board during the recording.
    cut_bytes : int
        Number of bytes of incomplete frames at the ends of the files.
    read_bytes : int
        Number of bytes read.
    end_s : float
        Time of the last note that was read, in seconds, on the same clock as the times of arrival.
    complete : bool
        Whether the iteration has found the note that ends a complete recording, and no data after
        it.
    marks : list of Mark
        Marks that were read.
    joined : bool
        Whether data follows the note that ends the recording: files were joined.

    Raises
    ------
    SpotsError
        If the file is not a recording, a later file is missing although a file after it exists, or
        files of the recording have each other's names.

    Examples
    --------
    >>> from spots import Recording
    >>> recording = Recording("run.spots")
    >>> sum(isinstance(frame, spots.Touch) for arrived_s, frame in recording)
    300
    """

    def __init__(self, path: str | Path):
        self.path = Path(path_text(path, "the path of a recording"))
        self.header = read(self.path, file_blocks(self.path))
        self.headers = {self.path: self.header, **_others(self.path, self.header)}
        self.paths = list(self.headers)
        self.size = sum(path.stat().st_size for path in self.paths)
        self._restart()

    def __iter__(self) -> Iterator[tuple[float, Frame]]:
        for path, header, block in self._blocks(_BLOCK_BYTES):
            for frame in self._decoder.feed(block):
                if isinstance(frame, Note):
                    self._note(path, header, frame)
                else:
                    timed = self._clock.timed(frame, self.end_s)
                    if isinstance(timed, Touch):
                        timed = with_sigma(timed, self._certainties)
                    yield self.end_s, timed

    def _blocks(self, size: int) -> Iterator[tuple[Path, Header, bytes]]:
        """Yield blocks of at most `size` bytes in order, with path and header of their file."""
        self._restart()
        start = b""
        self._decoder.expect(self.header.sequence)
        for path, header in self.headers.items():
            self._clock = _clock_map(header.clock)
            self._certainties = header.certainties
            self._decoder.restarted(header.restarts)
            self.end_s = header.host_s
            self._seen_utc(header.utc_s)
            for block in chain([start], file_blocks(path, size)):
                self.read_bytes += len(block)
                yield path, header, block
            self.cut_bytes += len(self._decoder.pending)
            start = b"\0"  # an incomplete frame of one file does not continue in the next
        self._read = True

    def _note(self, path: Path, header: Header, note: Note) -> None:
        self.notes += 1
        self.end_s = header.host_s + 1e-6 * note.since_us
        if "clock" in note.content:
            self._clock = _noted(path, note.content["clock"])
        utc_s = note.content.get("utc_s")
        if isinstance(utc_s, (int, float)) and 0 <= utc_s <= UTC_MOST_S:
            self._seen_utc(utc_s)
        mark = note.content.get("mark")
        if isinstance(mark, str):
            self.marks.append(Mark(self.end_s, printable(mark)))
        self.joined |= self._ended_in == path and bool(note.content)
        if note.content.get("end") is True:
            self._ended_in = path

    def _seen_utc(self, utc_s: float) -> None:
        self._utc.append(Seen(self.end_s, utc_s, self._clock.slept_s))

    @property
    def utc(self) -> Utc:
        """Conversion of host times to UTC, from the data that the iteration has read."""
        return Utc(self._utc)

    @property
    def complete(self) -> bool:
        return self._ended_in is not None and not self.joined

    @property
    def doubts(self) -> list[str]:
        """What is wrong with the data that the iteration has read; empty if nothing is wrong.

        Valid after the iteration has ended: a missing end mark is unknown before.
        """
        stats, doubts = self.stats, []
        if self.joined:
            doubts.append("data follows its end mark: two recordings were joined")
        elif self._ended_in is None and self._read:
            doubts.append("it has no end mark: it was cut off, or is still being recorded")
        if stats.bad_crc:
            doubts.append(f"{stats.bad_crc} of its frames are damaged")
        if stats.lost:
            doubts.append(f"{stats.lost} of its frames are missing")
        return doubts

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
        self._ended_in: Path | None = None  # a Ctrl-C may leave a later file with a header only
        self.joined = False
        self.marks: list[Mark] = []
        self._utc: list[Seen] = []
        self._read = False  # whether the iteration has ended


def _clock_map(known: Clock) -> ClockMap:
    return ClockMap(**msgspec.structs.asdict(known))


def _noted(path: Path, content: object) -> ClockMap:
    try:
        return _clock_map(msgspec.convert(content, Clock))
    except msgspec.ValidationError as error:
        raise FileError(
            f"{path} is damaged: a block of its metadata is invalid ({error}); name another file",
            path,
        ) from None


def _others(path: Path, first: Header) -> dict[Path, Header]:
    """Return a recording's later files and their headers, if `path` is its first file."""
    if first.part != 0:
        return {}
    found = {}
    for part in parts_beside(path):
        file = part_path(path, part)
        try:
            header = read(file, file_blocks(file))
        except SpotsError:
            continue  # not a recording, so not a part of this set
        if header.set == first.set:
            if header.part != part:
                right = part_path(path, header.part)
                raise FileError(
                    f"{file} is the file {right.name} of this recording: rename it", file
                )
            found[part] = (file, header)
    for part in range(1, max(found, default=0)):
        if part not in found:
            raise FileError(
                f"{part_path(path, part)} is missing or damaged: restore it, or rename {path} and "
                "read each file separately",
                part_path(path, part),
            )
    return dict(found.values())


def file_blocks(path: Path, size: int = _BLOCK_BYTES) -> Iterator[bytes]:
    """Yield the content of a recording's file in blocks of at most `size` bytes."""
    try:
        with open_regular(path) as file:
            while block := file.read(size):
                yield block
    except FileNotFoundError:
        raise FileError(
            f"there is no file {path}: name a file that 'spots record' has made", path
        ) from None
    except OSError as error:
        raise kinds.not_read(path, error, "a recording") from None
