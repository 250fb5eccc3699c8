"""What a recording tells before its first frame: whose it is, and how its times are meant."""

from __future__ import annotations

import json
from collections.abc import Iterable
from pathlib import Path

import msgspec

from tactile import PROTOCOL

from ..errors import SpotsError
from ..frames import Decoder, Note
from .note import note

VERSION = 1
# So much of a header's text goes into a note; escaped it is twice as long at most.
_PIECE = 200
_COPIES = 2
# A board's longest calibration, twice, and half as much again.
_SEARCHED_BYTES = 1 << 17


class Clock(msgspec.Struct, frozen=True):
    """State of the `clockmap.ClockMap` when the recording began; see its `state`."""

    last_us: int
    low_s: float
    high_s: float
    at_us: int = 0
    slope: float = 0.0


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
    """

    recording: int
    program: str
    set: str
    part: int
    host_s: float
    utc_s: float
    info: dict
    clock: Clock | None = None
    calibration: list[str] | None = None


def encoded(header: Header) -> bytes:
    """Return a header as notes, twice, so that damage at one place spares one of each."""
    text = msgspec.json.encode(header).decode()
    text = json.dumps(json.loads(text))  # ASCII, so that no cut divides a character
    pieces = [text[i : i + _PIECE] for i in range(0, len(text), _PIECE)]
    of = len(pieces)
    notes = [note(0, {"header": piece, "i": i, "of": of}) for i, piece in enumerate(pieces)]
    return b"".join(notes) * _COPIES


def read(path: Path, blocks: Iterable[bytes]) -> Header:
    """Return the header of a recording.

    Parameters
    ----------
    path : Path
        To name it.
    blocks : iterable of bytes
        Its content from the start.

    Raises
    ------
    SpotsError
        If there is none, or none that this program understands.
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
    except (KeyError, TypeError, ValueError, msgspec.MsgspecError) as error:
        raise SpotsError(f"{path}: the header is none of ours: {error}") from None
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
    return header
