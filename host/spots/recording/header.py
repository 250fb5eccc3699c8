"""Header of a recording: its board, its clocks."""

from __future__ import annotations

import json
from collections.abc import Iterable
from pathlib import Path
from typing import Annotated

import msgspec

from spots_device import PROTOCOL

from ..errors import SpotsError
from ..link.frames import Decoder, Note
from ..link.replies import validated
from .note import note

VERSION = 1
# So much of a header's text goes into a note; escaped it is twice as long at most.
_PIECE = 200
_COPIES = 2
# A board's longest calibration, twice, and half as much again.
_SEARCHED_BYTES = 1 << 17


# So long since a clock began, either way: a float still resolves 1e-6 s.
_Clock_s = Annotated[float, msgspec.Meta(ge=-1e9, le=1e9)]
_Utc_s = Annotated[float, msgspec.Meta(ge=0, le=1e10)]


class Clock(msgspec.Struct, frozen=True):
    """State of the `link.clockmap.ClockMap` when the recording began; see its `state`."""

    last_us: Annotated[int, msgspec.Meta(ge=-(1 << 50), le=1 << 50)]
    low_s: _Clock_s
    high_s: _Clock_s
    at_us: Annotated[int, msgspec.Meta(ge=-(1 << 50), le=1 << 50)] = 0
    slope: Annotated[float, msgspec.Meta(ge=-0.1, le=0.1)] = 0.0


class Header(msgspec.Struct, frozen=True, kw_only=True):
    """Header of a recording. Keys that a reader does not know mean nothing to it.

    Attributes
    ----------
    recording : int
        Version of the format.
    program : str
        What wrote it.
    set, part : str, int
        Files of one recording have the same `set` and count from 0.
    host_s, utc_s : float
        The host's monotonic clock, and seconds since 1970, at time 0 of the notes.
    info : dict
        The board's answer to ``hello``.
    clock : Clock
        From the board's time to the host's monotonic clock.
    calibration : list of str or None
        The board's calibration, where the host knew it.
    restarts : int
        How often the board had restarted by then, since it was opened.
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
    restarts: int = 0


def encoded(header: Header) -> bytes:
    """Return a header as notes, twice, so that damage at one place spares one of each."""
    text = msgspec.json.encode(header).decode()
    text = json.dumps(json.loads(text))  # ASCII, so that no cut divides a character
    pieces = [text[i : i + _PIECE] for i in range(0, len(text), _PIECE)]
    of = len(pieces)
    notes = [note(0, {"header": piece, "i": i, "of": of}) for i, piece in enumerate(pieces)]
    return b"".join(notes) * _COPIES


def read(path: Path, blocks: Iterable[bytes]) -> Header:
    """Read and validate the header of a recording.

    Parameters
    ----------
    path : Path
        The file, for error messages only.
    blocks : iterable of bytes
        The content of the file, from its start.

    Returns
    -------
    Header

    Raises
    ------
    SpotsError
        If there is no header, or it is invalid.
    """
    decoder, pieces, searched = Decoder(), {}, 0
    for block in blocks:
        for frame in decoder.feed(block):
            if not isinstance(frame, Note) or "header" not in frame.content:
                continue
            i = frame.content.get("i")
            if isinstance(i, int):
                pieces[i] = frame.content["header"]
            if len(pieces) == frame.content.get("of"):
                return _parsed(path, pieces)
        searched += len(block)
        if searched > _SEARCHED_BYTES:
            break
    if not pieces:
        raise SpotsError(f"{path} is no recording: 'spots record' makes them")
    raise SpotsError(f"{path} cannot be read: its header is cut short or damaged in both copies")


def _parsed(path: Path, pieces: dict) -> Header:
    try:
        text = "".join(pieces[i] for i in range(len(pieces)))
        version = json.loads(text)["recording"]
        header = msgspec.json.decode(text, type=Header) if version == VERSION else None
        info = validated("hello", header.info) if header else {}
    except (KeyError, TypeError, ValueError, RecursionError, msgspec.MsgspecError) as error:
        raise SpotsError(f"{path}: the header is invalid: {error}") from None
    if header is None:
        raise SpotsError(
            f"{path} is a recording of version {version}, this program reads {VERSION}: update it"
        )
    protocol = header.info.get("protocol")
    if protocol != PROTOCOL:
        raise SpotsError(
            f"{path} is of a board that speaks protocol {protocol}, this program {PROTOCOL}: use "
            f"the program that wrote it, {header.program}"
        )
    return msgspec.structs.replace(header, info=info)
