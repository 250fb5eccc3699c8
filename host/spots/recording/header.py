"""The header of a recording: board and clocks; see docs/program/recording-format.md."""

import json
from collections.abc import Iterable
from pathlib import Path
from typing import Annotated

import msgspec

from spots_device import PROTOCOL

from ..common import kinds
from ..common.certainty import Certainty
from ..errors import FileError
from ..link.decoder import Decoder, note
from ..link.frames import Note
from ..link.replies import validated

VERSION = 1
PROTOCOLS = 2, PROTOCOL  # those of boards whose frames this program reads
_PIECE = 200  # characters of the header in a note; JSON's escapes may double their number
_COPIES = 2  # of the header in a file
# Number of bytes that are searched for the header: enough for both copies of a header with the
# longest calibration.
_SEARCHED_BYTES = 1 << 17

# Seconds since the start of a clock; at 1e9 s a float still resolves 1e-6 s.
_Clock_s = Annotated[float, msgspec.Meta(ge=-1e9, le=1e9)]
UTC_MOST_S = 1e10
_Utc_s = Annotated[float, msgspec.Meta(ge=0, le=UTC_MOST_S)]


class Clock(msgspec.Struct, frozen=True):
    """How to convert board time to host time: constructor arguments of `link.clockmap.ClockMap`."""

    last_us: Annotated[int, msgspec.Meta(ge=-(1 << 50), le=1 << 50)]
    low_s: _Clock_s
    high_s: _Clock_s
    at_us: Annotated[int, msgspec.Meta(ge=-(1 << 50), le=1 << 50)] = 0
    slope: Annotated[float, msgspec.Meta(ge=-0.1, le=0.1)] = 0.0
    slept_s: Annotated[float, msgspec.Meta(ge=0, le=1e9)] = 0.0


class Header(msgspec.Struct, frozen=True, kw_only=True):
    """Header of a recording's file. A reader ignores unknown keys.

    Attributes
    ----------
    recording : int
        Version of the file format.
    program : str
        Name and version of the program that wrote the recording.
    set : str
        Random name that all files of one recording share.
    part : int
        Number of this file in the recording, from 0.
    host_s, utc_s : float
        Start of the file, in seconds: on the host's monotonic clock, and since 1970. Times in the
        file's notes (metadata between frames) count from this start.
    info : dict
        The board's reply to ``hello``.
    clock : Clock
        Map from the board's time to the host's monotonic clock.
    calibration : list of str or None
        Lines of the board's calibration; None if unknown.
    calibrations : list of (list of str or None), or None
        The same for the other sensors, from 1 on.
    recalibrated : bool
        Whether the readings were computed again with these calibrations, see `recalibrate`.
    restarts : int
        Number of restarts of the board after it was opened and before this file began.
    sequence : int or None
        Number of the first frame, modulo 2**16, so that a gap before it counts as loss; None if
        unknown.
    dark : list of list of int or None
        For each sensor, the dark frame at the start of the recording, as in `replies.DarkFrame`;
        None if unknown.
    """

    recording: int
    program: str
    set: str
    part: int
    host_s: _Clock_s
    utc_s: _Utc_s
    info: dict
    clock: Clock
    calibration: list[str] | None = None
    calibrations: list[list[str] | None] | None = None
    recalibrated: bool = False
    restarts: int = 0
    sequence: Annotated[int, msgspec.Meta(ge=0, lt=1 << 16)] | None = None
    dark: list[list[int]] | None = None

    @property
    def strips(self) -> list[dict]:
        """For each sensor, the board's reply to ``hello``."""
        strips = self.info.get("strips")
        valid = isinstance(strips, list) and strips and all(isinstance(s, dict) for s in strips)
        return strips if valid else [self.info]

    @property
    def certainties(self) -> dict[int, Certainty]:
        """The certainty of positions, for each sensor whose calibration is known."""
        return Certainty.by_sensor([self.calibration, *(self.calibrations or ())], self.strips)

    @property
    def settings(self) -> list[dict]:
        """For each sensor, the reply to ``hello``, and ``dark``: its dark frame or None."""
        dark = self.dark or [None] * len(self.strips)
        return [{**info, "dark": one} for info, one in zip(self.strips, dark)]


def encoded(header: Header) -> bytes:
    """Encode a header as notes, which are pieces of metadata in a recording.

    Each note occurs twice, in case one copy is damaged.
    """
    text = json.dumps(msgspec.to_builtins(header))  # ASCII, so no cut divides a character
    pieces = [text[i : i + _PIECE] for i in range(0, len(text), _PIECE)]
    of = len(pieces)
    notes = [note(0, {"header": piece, "i": i, "of": of}) for i, piece in enumerate(pieces)]
    return b"".join(notes) * _COPIES


def read(path: Path, blocks: Iterable[bytes]) -> Header:
    """Read and validate the header of a recording; `path` is for error messages only.

    FileError if the file has no header, its header is invalid, or this program cannot read its
    version or the board's protocol.
    """
    decoder, pieces, searched = Decoder(), {}, bytearray()
    for block in blocks:
        for frame in decoder.feed(block):
            if not isinstance(frame, Note) or "header" not in frame.content:
                continue
            i = frame.content.get("i")
            if isinstance(i, int):
                pieces[i] = frame.content["header"]
            if len(pieces) == frame.content.get("of"):
                return _parsed(path, pieces)
        searched += block
        if len(searched) > _SEARCHED_BYTES:
            break
    if not pieces:
        kinds.check(path, bytes(searched), "a recording")
        raise FileError(
            f"{path} is not a recording: name a file that 'spots record' has made", path
        )
    raise FileError(
        f"{path} cannot be read, because its header is damaged or incomplete: name another file",
        path,
    )


def _parsed(path: Path, pieces: dict) -> Header:
    try:
        text = "".join(pieces[i] for i in range(len(pieces)))
        version = json.loads(text)["recording"]
        header = msgspec.json.decode(text, type=Header) if version == VERSION else None
        info = validated("hello", header.info) if header else {}
    except (KeyError, TypeError, ValueError, RecursionError, msgspec.MsgspecError) as error:
        raise FileError(
            f"{path} has an invalid header ({error}): make a new recording with this program", path
        ) from None
    if header is None:
        raise FileError(
            f"{path} has format version {version}, but this program reads {VERSION}: update this "
            "program",
            path,
        )
    protocol = header.info.get("protocol")
    if protocol not in PROTOCOLS:
        raise FileError(
            f"{path} was recorded from a board with protocol {protocol}, but this program reads "
            f"{PROTOCOL}: read the file with the program that wrote it, {header.program}",
            path,
        )
    return msgspec.structs.replace(header, info=info)
