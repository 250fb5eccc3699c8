"""Decodes the bytes of a board into frames; see docs/extend/protocol.md.

A recording also contains notes: frames that the recorder adds. They are encoded and decoded here.

The decoder has no I/O and no threads. Live links, recordings and the simulator all use it.
"""

import json
import math
import struct
import zlib
from collections import deque
from collections.abc import Callable
from typing import Any

import msgspec
from cobs import cobs  # pyright: ignore[reportMissingTypeStubs]

from spots_device.reading import decode, frame
from spots_device.reading.kernel import TOUCH_BODY
from spots_device.sensor.smux import CHANNELS

from ..errors import SettingError
from .frames import (
    Contact,
    Frame,
    Key,
    LinkStats,
    Note,
    Reading,
    Spectrum,
    Text,
    Touch,
    force_known,
    position_known,
)

_HEADER = struct.Struct("<BHHH")  # kind and sensor, sequence, time low, time high


_TOUCH = struct.Struct(TOUCH_BODY)


_SPECTRUM = struct.Struct(frame.SPECTRUM_BODY)


# What the body of a spectrum has after the counts; unknown in a recording of protocol 2.
SPECTRUM_REST = struct.pack("<6IiB", *[0] * CHANNELS, frame.UNKNOWN_MC, 0)


# Bytes of the body of a spectrum of protocol 2.
SPECTRUM_SHORT = _SPECTRUM.size - len(SPECTRUM_REST)


_KEY = struct.Struct(frame.KEY_BODY)


_CONTACT = struct.Struct(frame.CONTACT_BODY)


_CRC = struct.Struct("<I")


_object = msgspec.json.Decoder(dict[str, Any]).decode


# Bytes of the longest frame, without its delimiter. COBS adds one byte, and another for every 254
# bytes.
ENCODED_MAX = decode.HEADER_SIZE + frame.TEXT_MAX + decode.CRC_SIZE + 4


_SEQUENCES = 1 << 16
_TIMES = 1 << 32  # us after which the board's time starts at 0 again
_BACK_US = 60_000_000  # a frame may be older than the frame before it, by less than this
_RECENT = 64  # latest readings, which show how many frames the board sends in a time
_RECENT_LEAST = 8


_READINGS = frame.TOUCH, frame.SPECTRUM, frame.CONTACT


NOTE = 15  # kind of a note


def whole(data: bytes) -> int:
    """Return the number of bytes after which data can be cut without splitting a frame.

    The cut is after the last delimiter (a zero byte). Without a delimiter, return 0, because the
    frame is incomplete. But if data without a delimiter is longer than any valid frame, it is
    damaged: return its length.
    """
    size = data.rfind(b"\0") + 1
    return len(data) if not size and len(data) > ENCODED_MAX else size


class Decoder:
    """Decodes a byte stream, which may be damaged, into frames.

    If the CRC of the bytes between two delimiters is wrong, these bytes are dropped, and
    `stats.bad_crc` grows by one. The decoder resynchronises at the next delimiter. Memory is
    limited to the length of the longest frame.

    Attributes
    ----------
    stats : LinkStats
        Statistics of the stream.
    restarts : int
        Number of restarts of the board, from calls of `restarted` or from notes of a recording.

    Examples
    --------
    >>> decoder = Decoder()
    >>> decoder.feed(b"noise, then a delimiter" + bytes(1))
    []
    >>> decoder.stats.bad_crc
    1
    """

    def __init__(self):
        self.stats = LinkStats()
        self.restarts = 0
        self._partial = b""
        self._overlong = False
        self._expected: int | None = None
        self._lost_at_reading = 0
        # Time and number of the latest readings; no reply is between them.
        self._recent: deque[tuple[int, int]] = deque(maxlen=_RECENT)

    @property
    def pending(self) -> bytes:
        """The first bytes of a frame that is not complete yet."""
        return self._partial

    @property
    def expected(self) -> int | None:
        """Number of the next frame, modulo 2**16; None before the first frame."""
        return self._expected

    def expect(self, sequence: int | None) -> None:
        """Count a gap before the next frame as loss; `sequence` is its number, as in `expected`."""
        self._expected = sequence

    def forget(self) -> None:
        """Drop the incomplete frame, and do not count a gap before the next frame as loss."""
        self._partial, self._overlong, self._expected = b"", False, None
        self._recent.clear()

    def feed(self, data: bytes) -> list[Frame]:
        """Add bytes, in any amount, and return the frames that are now complete."""
        kinds = bytes, bytearray, memoryview
        if not isinstance(data, kinds):  # pyright: ignore[reportUnnecessaryIsInstance]
            raise SettingError(f"a decoder needs bytes, not {data!r:.40}")
        frames = [self._take(piece) for piece in self._completed(data).split(b"\0") if piece]
        return [found for found in frames if found is not None]

    def restarted(self, restarts: int) -> None:
        """Set the number of restarts of the board.

        A restarted board counts its frames from 0 again, which looks like a loss of frames. So, if
        the number of restarts has grown, losses counted since the last reading are removed from
        `stats`. No reading was lost: a restarted board sends none until its streams resume.
        """
        if restarts > self.restarts:
            self.restarts = restarts
            self.stats.lost = min(self.stats.lost, self._lost_at_reading)
            self._recent.clear()

    def _completed(self, data: bytes) -> bytes:
        """Return the bytes up to the last delimiter; store the bytes after it for the next call."""
        self.stats.bytes += len(data)
        data = self._partial + data
        end = data.rfind(b"\0") + 1
        begin = 0
        if self._overlong and end:
            begin = data.index(b"\0") + 1
            self._overlong = False
        self._partial = data[end:]
        if self._overlong or len(self._partial) > ENCODED_MAX:
            self.stats.bad_crc += not self._overlong
            self._overlong, self._partial = True, b""
        return data[begin:end]

    def _take(self, piece: bytes) -> Frame | None:
        # A piece that is longer than any frame is invalid.
        payload = checked(piece) if len(piece) <= ENCODED_MAX else None
        if payload is None:
            self.stats.bad_crc += 1
            return None
        kind, sequence, low, high = _HEADER.unpack_from(payload)
        if kind & 0x0F != NOTE:
            self._count(kind & 0x0F, sequence, low | high << 16)
        parse = PARSERS.get(kind & 0x0F)
        if parse is None:
            return None
        try:
            found = parse(kind >> 4, sequence, low | high << 16, payload[decode.HEADER_SIZE :])
        except (struct.error, ValueError):
            self.stats.bad_crc += 1
            return None
        if isinstance(found, Note) and isinstance(found.content.get("restarts"), int):
            self.restarted(found.content["restarts"])
        return found

    def _count(self, kind: int, sequence: int, t_us: int) -> None:
        if self._expected is not None and (gap := (sequence - self._expected) % _SEQUENCES):
            usual = 0.0 if kind == frame.TEXT else self._usual(t_us)
            # The sequence gives the number of lost frames modulo 2**16; the time gives the rest.
            # It is negative if a frame was repeated, or the board restarted.
            self.stats.lost += max(
                0, gap + _SEQUENCES * math.ceil((usual - gap) / _SEQUENCES - 0.5)
            )
        self._expected = (sequence + 1) % _SEQUENCES
        self.stats.frames += 1
        if kind in _READINGS:
            self._lost_at_reading = self.stats.lost
            self._recent.append((t_us, self.stats.frames + self.stats.lost))
        elif kind == frame.TEXT:  # the streams may have changed
            self._recent.clear()

    def _usual(self, t_us: int) -> float:
        """Return how many frames the board usually sends from the last reading until `t_us`."""
        if len(self._recent) < _RECENT_LEAST:
            return 0.0
        (first_us, first), (last_us, last) = self._recent[0], self._recent[-1]
        since_us = (t_us - last_us + _BACK_US) % _TIMES - _BACK_US
        return since_us * (last - first) / max(1, (last_us - first_us) % _TIMES)


def checked(piece: bytes) -> bytes | None:
    """Return the payload of the bytes between two delimiters; None if these bytes are damaged."""
    try:
        payload = cobs.decode(piece)  # pyright: ignore[reportUnknownMemberType]
    except cobs.DecodeError:
        return None
    if len(payload) < decode.HEADER_SIZE + decode.CRC_SIZE:
        return None
    body, crc = payload[: -decode.CRC_SIZE], payload[-decode.CRC_SIZE :]
    return body if _CRC.pack(zlib.crc32(body)) == crc else None


def framed(payload: bytes) -> bytes:
    """Return a payload with its CRC as the bytes between two delimiters; `checked` undoes it."""
    return cobs.encode(payload + _CRC.pack(zlib.crc32(payload)))  # pyright: ignore[reportUnknownMemberType]


def note(since_us: int, content: dict[str, Any] | None = None) -> bytes:
    """Encode a note, an entry that a recorder adds between frames; see `Note`.

    `since_us` is the host time since the recording's file began, up to 2**48 - 1. The content may
    have `spots_device.reading.frame.TEXT_MAX` bytes as JSON.
    """
    low, high, sequence = (since_us >> shift & 0xFFFF for shift in (0, 16, 32))
    payload = _HEADER.pack(NOTE, sequence, low, high)
    if content is not None:
        payload += json.dumps(content, separators=(",", ":")).encode()
    return framed(payload) + b"\0"


def _touch(sensor: int, sequence: int, t_us: int, body: bytes) -> Touch:
    flags, contrast, brightness, position_um, force_mN = _TOUCH.unpack(body)
    if not position_known(flags, force_mN):
        position_um = math.nan
    if not force_known(flags):
        force_mN = math.nan
    return Touch(sensor, sequence, t_us, flags, contrast, brightness, position_um, force_mN)


def _spectrum(sensor: int, sequence: int, t_us: int, body: bytes) -> Spectrum:
    if len(body) == SPECTRUM_SHORT:
        body += SPECTRUM_REST
    flags, gain, *words, mC, context = _SPECTRUM.unpack(body)
    counts, taken_off = tuple(words[:CHANNELS]), tuple(words[CHANNELS:])
    return Spectrum(sensor, sequence, t_us, flags, gain, counts, None, taken_off, mC, context)


def _key(sensor: int, sequence: int, t_us: int, body: bytes) -> Key:
    page, usage, modifiers, pressed = _KEY.unpack(body)
    return Key(sensor, sequence, t_us, page, usage, modifiers, bool(pressed))


def _contact(sensor: int, sequence: int, t_us: int, body: bytes) -> Contact:
    number, state, position_um, sigma_um, force_mN = _CONTACT.unpack(body)
    return Contact(
        sensor, sequence, t_us, number, state, position_um, sigma_um, force_mN or math.nan
    )


def _text(sensor: int, sequence: int, t_us: int, body: bytes) -> Text:
    return Text(sensor, sequence, t_us, _object(body))


def _note(sensor: int, sequence: int, t_us: int, body: bytes) -> Note:
    return Note(sequence << 32 | t_us, _object(body) if body else {})


# Parsers by kind of frame. They raise struct.error or ValueError if the body is invalid.
PARSERS: dict[int, Callable[[int, int, int, bytes], Frame]] = {
    frame.TOUCH: _touch,
    frame.SPECTRUM: _spectrum,
    frame.KEY: _key,
    frame.CONTACT: _contact,
    frame.TEXT: _text,
    NOTE: _note,
}


# Kinds of frames whose body has a fixed size: their type, and the body's format for `struct`.
LAYOUTS: dict[int, tuple[type[Reading], str]] = {
    frame.TOUCH: (Touch, TOUCH_BODY),
    frame.SPECTRUM: (Spectrum, frame.SPECTRUM_BODY),
    frame.KEY: (Key, frame.KEY_BODY),
    frame.CONTACT: (Contact, frame.CONTACT_BODY),
}
