"""Bytes from a board to frames. No I/O, no threads; see docs/protocol.md.

One decoder serves live links, recordings and the simulator.
"""

from __future__ import annotations

import math
import struct
import zlib
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, NamedTuple, Union

import msgspec
from cobs import cobs  # pyright: ignore[reportMissingTypeStubs]

from spots_device import decode, frame
from spots_device.kernel import CRC_SIZE

_HEADER = struct.Struct(frame.HEADER)
_TOUCH = struct.Struct("<" + frame.TOUCH_BODY)
_SPECTRUM = struct.Struct("<" + frame.SPECTRUM_BODY)
_KEY = struct.Struct("<" + frame.KEY_BODY)
_CRC = struct.Struct("<I")
# COBS adds one byte, and one more for each 254.
ENCODED_MAX = frame.HEADER_SIZE + frame.TEXT_MAX + CRC_SIZE + 4
_SEQUENCES = 1 << 16
_READINGS = frame.TOUCH, frame.SPECTRUM
NOTE = 15


def whole(data: bytes) -> int:
    """Return how many bytes are whole frames, or noise that is longer than any frame."""
    size = data.rfind(b"\0") + 1
    return len(data) if not size and len(data) > ENCODED_MAX else size


DOUBTFUL = (
    decode.SATURATED | decode.TOO_DARK | decode.MISFIT | decode.NOT_CALIBRATED | decode.LED_OFF
)


# Of these a board sends 0 as position and force.
_BLIND = decode.NOT_CALIBRATED | decode.LED_OFF


def _log2(value_q20: int, flags: int) -> float:
    unknown = not value_q20 and flags & (_BLIND | decode.TOO_DARK)
    return math.nan if unknown else value_q20 / (1 << 20)


class Touch(NamedTuple):
    """One reading of a strip.

    Attributes
    ----------
    sensor : int
        Which sensor of the board.
    sequence : int
        Number of the frame on its link, modulo 2**16.
    t_us : int
        Board time of the middle of the integration, modulo 2**32.
    flags : int
        Bits of `spots_device.decode`.
    contrast_q20, brightness_q20 : int
        log2 units times 2**20; see the properties.
    position_um : float
        Distance of the press from the sensor's end of the strip; NaN without a touch, and where
        the LED was off.
    force_mN : float
        Force of the press; NaN without a calibration, and where the LED was off.
    time_s : float or None
        The same moment on the host's monotonic clock, where the link knows it. The clocks are
        compared when the board is opened, and now and then while it streams.

    Examples
    --------
    >>> touch = Touch(0, 1, 5000, 9, 0, 0, 42_000, 1500, 1.25)
    >>> touch.trusted, touch.position_um / 1000
    (True, 42.0)
    """

    sensor: int
    sequence: int
    t_us: int
    flags: int
    contrast_q20: int
    brightness_q20: int
    position_um: float
    force_mN: float
    time_s: float | None = None

    @property
    def touching(self) -> bool:
        """Whether a finger is on the strip, with hysteresis."""
        return bool(self.flags & decode.TOUCHING)

    @property
    def trusted(self) -> bool:
        """Whether position and force are valid: touching, and no flag against it."""
        return self.touching and not self.flags & DOUBTFUL

    @property
    def contrast(self) -> float:
        """Position contrast, in units of log2; NaN where the light does not give one."""
        return _log2(self.contrast_q20, self.flags)

    @property
    def brightness(self) -> float:
        """Brightness, in units of log2 counts; NaN where the light does not give one."""
        return _log2(self.brightness_q20, self.flags)


class Spectrum(NamedTuple):
    """The six counts behind a reading, dark not subtracted.

    Attributes
    ----------
    gain : int
        Register code 0 to 10 for 0.5x to 512x.
    counts : tuple of int
        ADC 0 to 5, in the order of the board's channel plan.

    Examples
    --------
    >>> max(Spectrum(0, 1, 5000, 9, 9, (3, 5, 8, 13, 21, 34)).counts)
    34
    """

    sensor: int
    sequence: int
    t_us: int
    flags: int
    gain: int
    counts: tuple[int, ...]
    time_s: float | None = None


class Key(NamedTuple):
    """A key of the strip goes down or up.

    Attributes
    ----------
    page : int
        USB HID usage page: 7 keyboard, 12 consumer.
    usage, modifiers : int
        As in a USB HID report of that page.
    pressed : bool
        Whether it goes down.

    Examples
    --------
    >>> Key(0, 1, 5000, page=7, usage=4, modifiers=0, pressed=True).usage
    4
    """

    sensor: int
    sequence: int
    t_us: int
    page: int
    usage: int
    modifiers: int
    pressed: bool
    time_s: float | None = None


class Text(NamedTuple):
    """A reply to a command, or a log line.

    Examples
    --------
    >>> Text(0, 1, 5000, {"log": "error", "text": "no sensor"}).content["text"]
    'no sensor'
    """

    sensor: int
    sequence: int
    t_us: int
    content: dict[str, Any]


class Note(NamedTuple):
    """An entry of a recorder between a board's frames, see docs/recording.md. No board sends it.

    Attributes
    ----------
    since_us : int
        Host time since the recording began; 48 bits.
    content : dict
        What the recorder notes; empty where it only notes the time.

    Examples
    --------
    >>> Note(1_500_000, {"end": True}).since_us / 1e6
    1.5
    """

    since_us: int
    content: dict[str, Any]


Reading = Union[Touch, Spectrum, Key]  # what a board streams
Frame = Union[Reading, Text, Note]


@dataclass
class LinkStats:
    """Health of a link.

    Attributes
    ----------
    frames : int
        Good frames, those of unknown kinds included; notes do not count.
    lost : int
        Frames that are missing, by their sequence numbers.
    bad_crc : int
        Pieces between two delimiters that were damaged.
    bytes : int
        All bytes received.
    restarts : int
        How often `Board` found that the board had restarted.
    overrun : int
        Frames that `Board` dropped, since the program did not take them in time.

    Examples
    --------
    >>> stats = LinkStats(frames=99, lost=1)
    >>> stats.lost / (stats.frames + stats.lost)
    0.01
    """

    frames: int = 0
    lost: int = 0
    bad_crc: int = 0
    bytes: int = 0
    restarts: int = 0
    overrun: int = 0


class Decoder:
    """Decodes a byte stream into frames, however damaged it is.

    A piece that fails its CRC is counted and dropped; the next delimiter resynchronises. Memory is
    bounded by the longest frame.

    Attributes
    ----------
    stats : LinkStats
    restarts : int
        How often the board has restarted, as reported by `restarted` or by notes.

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
        self._rest = b""
        self._overlong = False
        self._expected: int | None = None
        self._lost_at_reading = 0

    @property
    def pending(self) -> bytes:
        """The beginning of a frame whose end has not come."""
        return self._rest

    def forget(self) -> None:
        """Begin in the middle of a stream: any sequence number may be next."""
        self._rest, self._overlong, self._expected = b"", False, None

    def feed(self, data: bytes) -> list[Frame]:
        """Take bytes in pieces of any size and return the frames that they complete."""
        self.stats.bytes += len(data)
        *pieces, rest = (self._rest + data).split(b"\0")
        frames: list[Frame] = []
        for piece in pieces:
            if self._overlong:
                self._overlong = False
            elif piece:
                self._take(piece, frames)
        if self._overlong or len(rest) > ENCODED_MAX:
            if not self._overlong:
                self.stats.bad_crc += 1
            self._overlong, rest = True, b""
        self._rest = rest
        return frames

    def restarted(self, restarts: int) -> None:
        """Record how often the board has restarted by now.

        If that is more often than before, it counts its frames from 0 again. Then nothing was lost
        since its last reading: it sends no readings until its streams are started again.
        """
        if restarts > self.restarts:
            self.restarts = restarts
            self.stats.lost = min(self.stats.lost, self._lost_at_reading)

    def _take(self, piece: bytes, frames: list[Frame]) -> None:
        # However it was cut into pieces, what is longer than any frame is invalid.
        payload = checked(piece) if len(piece) <= ENCODED_MAX else None
        if payload is None:
            self.stats.bad_crc += 1
            return
        kind, sequence, low, high = _HEADER.unpack_from(payload)
        if kind & 0x0F != NOTE:
            self._count(sequence)
            if kind & 0x0F in _READINGS:
                self._lost_at_reading = self.stats.lost
        parse = PARSERS.get(kind & 0x0F)
        if parse is not None:
            try:
                body = payload[frame.HEADER_SIZE :]
                found = parse(kind >> 4, sequence, low | high << 16, body)
            except (struct.error, ValueError):
                self.stats.bad_crc += 1
            else:
                frames.append(found)
                if isinstance(found, Note):
                    self._noted(found.content)

    def _noted(self, content: dict[str, Any]) -> None:
        restarts = content.get("restarts")
        if isinstance(restarts, int):
            self.restarted(restarts)

    def _count(self, sequence: int) -> None:
        if self._expected is not None:
            gap = (sequence - self._expected) % _SEQUENCES
            if gap < _SEQUENCES // 2:  # else an old frame came again, or the board restarted
                self.stats.lost += gap
        self._expected = (sequence + 1) % _SEQUENCES
        self.stats.frames += 1


def checked(piece: bytes) -> bytes | None:
    """Return what a piece between two delimiters carries, None if it is damaged."""
    try:
        payload = cobs.decode(piece)  # pyright: ignore[reportUnknownMemberType]
    except cobs.DecodeError:
        return None
    if len(payload) < frame.HEADER_SIZE + CRC_SIZE:
        return None
    body, crc = payload[:-CRC_SIZE], payload[-CRC_SIZE:]
    return body if _CRC.pack(zlib.crc32(body)) == crc else None


def _touch(sensor: int, sequence: int, t_us: int, body: bytes) -> Touch:
    flags, contrast, brightness, position_um, force_mN = _TOUCH.unpack(body)
    if flags & _BLIND or not flags & decode.TOUCHING:
        position_um = math.nan
    if flags & _BLIND:
        force_mN = math.nan
    return Touch(sensor, sequence, t_us, flags, contrast, brightness, position_um, force_mN)


def _spectrum(sensor: int, sequence: int, t_us: int, body: bytes) -> Spectrum:
    flags, gain, *counts = _SPECTRUM.unpack(body)
    return Spectrum(sensor, sequence, t_us, flags, gain, tuple(counts))


def _key(sensor: int, sequence: int, t_us: int, body: bytes) -> Key:
    page, usage, modifiers, pressed = _KEY.unpack(body)
    return Key(sensor, sequence, t_us, page, usage, modifiers, bool(pressed))


def _text(sensor: int, sequence: int, t_us: int, body: bytes) -> Text:
    return Text(sensor, sequence, t_us, _object(body))


def _note(sensor: int, sequence: int, t_us: int, body: bytes) -> Note:
    return Note(sequence << 32 | t_us, _object(body) if body else {})


def _object(body: bytes) -> dict[str, Any]:
    return msgspec.json.decode(body, type=dict[str, Any])


# By kind: sensor, sequence, time and body to a frame; struct.error or ValueError if invalid.
PARSERS: dict[int, Callable[[int, int, int, bytes], Frame]] = {
    frame.TOUCH: _touch,
    frame.SPECTRUM: _spectrum,
    frame.KEY: _key,
    frame.TEXT: _text,
    NOTE: _note,
}
