"""Computes positions and forces of a recording again with another calibration.

The spectra of the recording pass through the arithmetic of the board's firmware, see
`replayed_strip`.
"""

import struct
from collections import deque
from collections.abc import Iterable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import IO, Any, NamedTuple

import msgspec

from spots_device.board.settings import checksum
from spots_device.reading import decode, frame
from spots_device.reading.calibration import Calibration
from spots_device.reading.kernel import TOUCH_BODY

from ..calibrate.calibration_file import FINGER, INDENTER, load
from ..calibrate.pressers import is_known, used_by
from ..common import atomic
from ..errors import CalibrationError, FileError, SettingError
from ..link.decoder import NOTE, PARSERS, SPECTRUM_SHORT, checked, framed
from ..link.frames import Spectrum
from .arrays import Arrays, read_arrays
from .export import Files
from .header import Header, encoded
from .recording import Recording, file_blocks
from .replayed_strip import ReplayedStrip, Values, unknown
from .writer import part_path

_HEAD = struct.Struct("<BHHH")
_TOUCH = struct.Struct(TOUCH_BODY)
_BLOCK_BYTES = 1 << 16
_SPECTRUM_SIZE = struct.calcsize(frame.SPECTRUM_BODY)
_CONFIGURING = "hello", "get", "set", "autoexpose", "cal", "layout"  # replies with settings
_SEQUENCES = 1 << 16


class Recalibrated(NamedTuple):
    """Result of `recalibrate`: the new files, and how many readings they have.

    `unknown` counts the readings that could not be computed; `why` has sentences about them.
    """

    paths: list[Path]
    known: int
    unknown: int
    why: list[str]


class _Reading:
    """A TOUCH frame whose values are not known yet."""

    def __init__(self, head: tuple[int, ...], flags: int):
        self.head, self.flags = head, flags
        self.values: Values | None = None

    @property
    def t_us(self) -> int:
        return self.head[2] | self.head[3] << 16

    @property
    def piece(self) -> bytes:
        """The frame with its new values."""
        assert self.values
        flags, *rest = self.values
        flags = flags & ~decode.DROPPED | self.flags & decode.DROPPED
        return framed(_HEAD.pack(*self.head) + _TOUCH.pack(flags, *rest))


class _Lane:
    """The readings of one strip: TOUCH frames, and the spectra from which they are computed."""

    def __init__(self, strip: ReplayedStrip):
        self.strip = strip
        self._touch: _Reading | None = None  # waits for its spectrum
        self.known = self.unknown = 0
        self.why: dict[str, None] = {}

    def touch(self, reading: _Reading) -> None:
        self.end()
        self._touch = reading

    def spectrum(self, spectrum: Spectrum) -> None:
        values = self.strip.take(spectrum)
        if self._touch is not None and self._touch.t_us == spectrum.t_us:
            self._set(self._touch, values)
        self.end()

    def end(self) -> None:
        """Without its spectrum, a reading is unknown."""
        if self._touch is not None:
            self._set(self._touch, unknown(self._touch.flags))

    def _set(self, reading: _Reading, values: Values) -> None:
        self._touch, reading.values = None, values
        is_known = not values.flags & decode.NOT_CALIBRATED
        self.known += is_known
        self.unknown += not is_known
        if not is_known and self.strip.why_not:
            self.why[self.strip.why_not] = None


def _pieces(blocks: Iterable[bytes]) -> Iterator[tuple[bytes, bytes]]:
    """Yield the bytes between two delimiters, and the delimiter; it is missing after the last."""
    rest = b""
    for block in blocks:
        *pieces, rest = (rest + block).split(b"\0")
        yield from ((piece, b"\0") for piece in pieces)
    yield rest, b""


class _Rewriter:
    """Rewrites the frames of a recording with the readings of other calibrations."""

    def __init__(self, path: Path, lanes: dict[int, _Lane]):
        self._path = path
        self.lanes = lanes
        self._removed = 0  # CONTACT frames, whose numbers the later frames get
        # Each with its file and its delimiter. A reading waits for its values.
        self._queue: deque[tuple[IO[bytes], bytes | _Reading, bytes]] = deque()
        self._file: IO[bytes] | None = None

    def rewrite(self, blocks: Iterable[bytes], file: IO[bytes]) -> None:
        """Write the frames of a recording's file to a new file."""
        self._file = file
        for piece, end in _pieces(blocks):
            self._take(piece, end)
            self._write()

    def end(self) -> None:
        """End the recording: what is still unknown remains so."""
        for lane in self.lanes.values():
            lane.end()
        self._write()

    def _take(self, piece: bytes, end: bytes) -> None:
        payload = checked(piece) if piece and end else None
        if payload is None:
            if piece:
                self._put(piece, end)
            return
        head = _HEAD.unpack_from(payload)
        kind, sensor = head[0] & 0x0F, head[0] >> 4
        body = payload[_HEAD.size :]
        if kind == NOTE:
            if b'"header"' not in body:
                self._put(piece, end)
            return
        lane = self.lanes.get(sensor)
        head = (head[0], (head[1] - self._removed) % _SEQUENCES, *head[2:])
        if kind == frame.CONTACT:
            self._removed += 1  # it was computed with the other calibration
            return
        if lane is not None:
            if kind == frame.TOUCH and len(body) == _TOUCH.size:
                reading = _Reading(head, body[0])
                lane.touch(reading)
                self._put(reading, end)
                return
            if kind == frame.SPECTRUM and len(body) == SPECTRUM_SHORT:
                raise FileError(_SHORT.format(path=self._path), self._path)
            if kind == frame.SPECTRUM and len(body) == _SPECTRUM_SIZE:
                lane.spectrum(_spectrum(payload))
        if kind == frame.TEXT:
            self._configure(body)
        self._put(framed(_HEAD.pack(*head) + body) if self._removed else piece, end)

    def _write(self) -> None:
        while self._queue:
            file, one, end = self._queue[0]
            if isinstance(one, _Reading):
                if one.values is None:
                    return
                one = one.piece
            self._queue.popleft()
            file.write(one + end)

    def _put(self, one: bytes | _Reading, end: bytes) -> None:
        assert self._file
        self._queue.append((self._file, one, end))

    def _configure(self, body: bytes) -> None:
        try:
            content = msgspec.json.decode(body, type=dict[str, Any])
            sensor = msgspec.convert(content.get("sensor", 0), int)
        except msgspec.MsgspecError:
            return
        if sensor in self.lanes and content.get("re") in _CONFIGURING:
            self.lanes[sensor].strip.configure(content)


def _spectrum(payload: bytes) -> Spectrum:
    kind, sequence, low, high = _HEAD.unpack_from(payload)
    found = PARSERS[frame.SPECTRUM](kind >> 4, sequence, low | high << 16, payload[_HEAD.size :])
    assert isinstance(found, Spectrum)
    return found


def recalibrate(
    path: str | Path,
    calibrations: Sequence[str | Path | Sequence[str]],
    out: str | Path | None = None,
) -> Recalibrated:
    """Compute the readings of a recording again with other calibrations; write a new recording.

    The new recording has the same frames at the same times, except CONTACT frames, which belong to
    the old calibration. A reading that cannot be computed, or at whose settings the calibration
    cannot be used, gets the flag `decode.NOT_CALIBRATED`; its position and force are unknown. The
    readings of a strip without a new calibration stay as they are.

    A calibration is a path, or lines, for one strip. For ``run.spots``, `out` is
    ``run-recalibrated.spots`` by default. FileError if a file cannot be read, no reading can be
    computed, or the new file exists; CalibrationError if a calibration is invalid, or belongs to no
    strip of the recording; SettingError if two belong to one strip. Then no file is written.
    """
    recording = Recording(path)
    header = recording.header
    if header.recalibrated:
        raise FileError(f"{path} is already recalibrated: name the original recording", path)
    new = _by_sensor(recording, calibrations)
    lanes = {i: _Lane(ReplayedStrip(header.strips[i], lines)) for i, lines in new.items()}
    begin = Path(path)
    rewriter = _Rewriter(begin, lanes)
    out = Path(out) if out else begin.with_name(f"{begin.stem}-recalibrated{begin.suffix}")
    with Files() as files:
        for at, (one, part) in enumerate(recording.headers.items()):
            file = files.new(part_path(out, at))
            file.write(encoded(_renewed(part, new)))
            rewriter.rewrite(file_blocks(one, _BLOCK_BYTES), file)
        rewriter.end()
        known = sum(lane.known for lane in lanes.values())
        why = [*dict.fromkeys(why for lane in lanes.values() for why in lane.why)]
        if not known:
            because = why[0] if why else _NO_SPECTRA
            raise FileError(f"no reading of {path} can be computed again: {because}", path)
        paths = files.sync()
    return Recalibrated(paths, known, sum(lane.unknown for lane in lanes.values()), why)


_NO_SPECTRA = "it has no spectra: record it again with 'spots record'"
_SHORT = (
    "no reading of {path} can be computed again: its spectra do not contain the light that the "
    "board has subtracted; record it again with the present firmware"
)


def recalibrated(path: str | Path, *calibrations: str | Path | Sequence[str]) -> Arrays:
    """Read a recording as arrays, with the readings that another calibration gives.

    The readings are those that the board would have sent with this calibration, computed by the
    board's own arithmetic. In `Arrays.touches`, the column ``known`` is false where the calibration
    cannot be used, and where the spectrum of a reading was lost.

    Parameters
    ----------
    path : str or Path
        File of the recording, with spectra.
    *calibrations : str, Path or sequence of str
        For one or more strips: the path of a calibration file, or the lines of a calibration.

    Returns
    -------
    Arrays
        As from `read_arrays`, without contacts.

    Raises
    ------
    SpotsError
        As from `recalibrate`.

    Examples
    --------
    >>> import spots
    >>> touches = spots.recalibrated("run.spots", "new.toml").touches  # doctest: +SKIP
    """
    with atomic.temporary() as folder:
        out = folder / "recalibrated.spots"
        recalibrate(path, calibrations, out)
        return read_arrays(out)


def _lines(one: str | Path | Sequence[str], strips: Sequence[Mapping[str, Any]]) -> list[str]:
    """Return lines of a calibration; of a file, those for what pressed the recorded strip."""
    if not isinstance(one, (str, Path)):
        return list(one)
    made = load(Path(one))
    presser = next((info.get("presser") for info in strips if info.get("id") == made.board), None)
    if presser in (FINGER, INDENTER) and is_known(made, presser):
        made = used_by(made, presser)
    return list(made.lines)


def _by_sensor(
    recording: Recording, calibrations: Sequence[str | Path | Sequence[str]]
) -> dict[int, list[str]]:
    sensors = {info.get("id"): i for i, info in enumerate(recording.header.strips)}
    found: dict[int, list[str]] = {}
    for one in calibrations:
        lines = _lines(one, recording.header.strips)
        try:
            board = Calibration(lines).conditions.board
        except ValueError as error:
            raise CalibrationError(f"a calibration is invalid: {error}") from None
        if board not in sensors:
            ids = ", ".join(map(str, sensors))
            raise CalibrationError(
                f"the calibration was made on board {board}, and {recording.path} is of {ids}: "
                "name a calibration of this board"
            )
        if sensors[board] in found:
            raise SettingError(f"two calibrations are for board {board}: name one of them")
        found[sensors[board]] = lines
    return found


def _own(header: Header, sensor: int) -> list[str] | None:
    every = [header.calibration, *(header.calibrations or [])]
    return every[sensor] if sensor < len(every) else None


def _renewed(header: Header, new: dict[int, list[str]]) -> Header:
    every = [new.get(i, _own(header, i)) for i in range(len(header.strips))]
    strips = [dict(info) for info in header.strips]
    for i, lines in new.items():
        made = Calibration(lines)
        strips[i].update(
            calibration=checksum(lines),
            length_um=made.length_um,
            decay=made.decay,
            relative_force=made.relative_force,
            presser=made.presser,
        )
    info = dict(header.info)
    info.update(strips[0])
    if "strips" in info:
        info["strips"] = [{k: v for k, v in one.items() if k != "strips"} for one in strips]
    return msgspec.structs.replace(
        header, info=info, calibration=every[0], calibrations=every[1:] or None, recalibrated=True
    )
