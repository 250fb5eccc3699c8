"""Decodes the bytes of a board into frames; see docs/extend/protocol.md.

A recording also contains notes: frames that the recorder adds. They are encoded and decoded here.

The decoder has no I/O and no threads. Live links, recordings and the simulator all use it.
"""

import json
import math
import struct
import zlib
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, NamedTuple, Union

import msgspec
from cobs import cobs  # pyright: ignore[reportMissingTypeStubs]

from spots_device.fingers import contacts as fingers
from spots_device.reading import decode, frame
from spots_device.reading.kernel import TOUCH_BODY

from ..errors import SettingError
from .former_names import present

_HEADER = struct.Struct("<BHHH")  # kind and sensor, sequence, time low, time high
_TOUCH = struct.Struct(TOUCH_BODY)
_SPECTRUM = struct.Struct("<BB6H")  # flags, gain, counts
_KEY = struct.Struct(frame.KEY_BODY)
_CONTACT = struct.Struct(frame.CONTACT_BODY)
_CRC = struct.Struct("<I")
_object = msgspec.json.Decoder(dict[str, Any]).decode
# Bytes of the longest frame, without its delimiter. COBS adds one byte, and another for every 254
# bytes.
ENCODED_MAX = decode.HEADER_SIZE + frame.TEXT_MAX + decode.CRC_SIZE + 4
_SEQUENCES = 1 << 16
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


# Flags of an untrusted reading.
DOUBTFUL = (
    decode.SATURATED | decode.TOO_DARK | decode.MISFIT | decode.NOT_CALIBRATED | decode.LED_OFF
)


# With these flags, a board sends 0 as position and force.
_BLIND = decode.NOT_CALIBRATED | decode.LED_OFF


def force_known(flags: Any) -> Any:
    """Return whether the force of a touch with these flags (an int, or an array) is known."""
    return flags & _BLIND == 0


def position_known(flags: Any, force_mN: Any) -> Any:
    """Return whether the position of a touch is known, from fields of a TOUCH frame, or arrays."""
    # A press that is too light for a touch has a position; without it, the host's key engine would
    # find touches one reading later than the board.
    return force_known(flags) & ((flags & decode.TOUCHING != 0) | (force_mN != 0))


def log2_unknown(value_q20: Any, flags: Any) -> Any:
    """Return whether contrast or brightness of a touch is unknown, also for arrays."""
    return (value_q20 == 0) & (flags & (_BLIND | decode.TOO_DARK) != 0)


def _log2(value_q20: int, flags: int) -> float:
    return math.nan if log2_unknown(value_q20, flags) else value_q20 / (1 << 20)


class Touch(NamedTuple):
    """One reading of a strip.

    Attributes
    ----------
    sensor : int
        Number of the sensor on the board, from 0.
    sequence : int
        Number of the frame, modulo 2**16; the board counts all its frames.
    t_us : int
        Board time of the middle of the exposure, in us, modulo 2**32.
    flags : int
        Bits that the module `spots_device.reading.decode` defines, such as `TOUCHING`.
    contrast_q20, brightness_q20 : int
        Values of `contrast` and `brightness`, times 2**20.
    position_um : float
        Distance of the press from the sensor's end of the strip, in um. NaN without a press,
        without a calibration, and while the LED is off. Inaccurate if the press is too light for a
        touch (`touching` is false).
    force_mN : float
        Force of the press, in mN; NaN without a calibration, and while the LED is off. If
        ``board.info["relative_force"]`` is true, the force has no unit.
    time_s : float or None
        Host time of the moment `t_us`, in seconds of the monotonic clock. None if the clocks of
        board and host were never compared; `Board` compares them when it opens a board, and
        regularly while the board streams.

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
        """Whether a finger touches. A touch ends at a lower force than it begins (hysteresis)."""
        return bool(self.flags & decode.TOUCHING)

    @property
    def trusted(self) -> bool:
        """Whether position and force are valid: a finger touches, and no flag reports a fault."""
        return self.touching and not self.flags & DOUBTFUL

    @property
    def integers(self) -> tuple[int, int]:
        """Position in um and force in mN as integers, with 0 instead of NaN."""
        position_um, force_mN = self.position_um, self.force_mN
        return (
            0 if math.isnan(position_um) else int(position_um),
            0 if math.isnan(force_mN) else int(force_mN),
        )

    @property
    def contrast(self) -> float:
        """Weighted sum of the counts' log2, which depends only on the position; NaN if unknown."""
        return _log2(self.contrast_q20, self.flags)

    @property
    def brightness(self) -> float:
        """Weighted sum of the counts' log2, which depends only on the coupled light; may be NaN.

        The coupled light is the light that a press lets into the dyed guide. NaN if unknown.
        """
        return _log2(self.brightness_q20, self.flags)


class Spectrum(NamedTuple):
    """The six raw counts of a reading, without subtraction of the dark frame.

    Attributes
    ----------
    sensor, sequence, t_us, flags, time_s
        See `Touch`.
    gain : int
        Code of the gain register, 0 to 10 for 0.5x to 512x.
    counts : tuple of int
        Counts of ADC 0 to 5. The board's setting ``channels`` names the channel of each ADC.

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
    """A press or a release of a key in the board's layout.

    Attributes
    ----------
    sensor, sequence, t_us, time_s
        See `Touch`.
    page : int
        USB HID usage page: 7 for the keyboard, 12 for consumer keys.
    usage : int
        USB HID usage of the key.
    modifiers : int
        Bits of all modifier keys that are down after the event, as in a keyboard report.
    pressed : bool
        Whether the key is pressed; False if it is released.

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


class Contact(NamedTuple):
    """One finger in one reading; the `Touch` of that reading has the same `t_us`.

    Attributes
    ----------
    sensor, sequence, t_us, time_s
        See `Touch`.
    id : int
        Number of the finger, modulo 256.
    state : int
        A state from `fingers.contacts`. First frame of a finger: `DOWN` (0). While another
        finger may be on the strip, or this finger may have lifted: `PROVISIONAL` (1). While this
        finger is alone: `CONFIRMED` (2). Last frame: `UP` (3), or `NEVER_ALONE` (4) if no frame of
        this finger was `CONFIRMED`.
    position_um : float
        Distance from the sensor's end of the strip, in um: measured while the finger is alone,
        otherwise estimated. The last frame has the last known position.
    sigma_um : float
        Standard deviation of the position due to noise, in um.
    force_mN : float
        Force, in mN; NaN unless the finger is alone.

    Examples
    --------
    >>> contact = Contact(0, 1, 5000, 7, 2, 42_000, 30, 1500)
    >>> contact.ended, contact.position_um / 1000
    (False, 42.0)
    """

    sensor: int
    sequence: int
    t_us: int
    id: int
    state: int
    position_um: float
    sigma_um: float
    force_mN: float
    time_s: float | None = None

    @property
    def ended(self) -> bool:
        """Whether this is the last frame of the finger."""
        return self.state in (fingers.UP, fingers.NEVER_ALONE)


class Text(NamedTuple):
    """A board's reply to a command, or a log line.

    Attributes
    ----------
    sensor, sequence, t_us
        See `Touch`; in a reply, `t_us` is the time at which it was sent.
    content : dict
        The JSON object of the reply or log line, see docs/extend/commands.md.

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
    """An entry that a recorder adds between frames; see docs/program/recording-format.md.

    Attributes
    ----------
    since_us : int
        Host time since the recording's file began, in us; 48 bits.
    content : dict
        Content of the entry; empty if the entry only has the time.

    Examples
    --------
    >>> Note(1_500_000, {"end": True}).since_us / 1e6
    1.5
    """

    since_us: int
    content: dict[str, Any]


Reading = Union[Touch, Spectrum, Key, Contact]  # frames of a stream
Frame = Union[Reading, Text, Note]


@dataclass
class LinkStats:
    """Statistics of a link.

    Attributes
    ----------
    frames : int
        Number of valid frames, including frames of unknown kinds, but not the notes in a recording.
    lost : int
        Number of missing frames, computed from gaps in the sequence numbers.
    bad_crc : int
        Number of damaged pieces; a piece is the bytes between two delimiters.
    bytes : int
        Number of bytes received.
    restarts : int
        Number of restarts of the board that `Board` has detected.
    overrun : int
        Number of frames that `Board` dropped, because the program did not read them in time.

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
            self._count(sequence)
            if kind & 0x0F in _READINGS:
                self._lost_at_reading = self.stats.lost
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

    def _count(self, sequence: int) -> None:
        if self._expected is not None:
            gap = (sequence - self._expected) % _SEQUENCES
            if gap < _SEQUENCES // 2:  # else a frame was repeated, or the board restarted
                self.stats.lost += gap
        self._expected = (sequence + 1) % _SEQUENCES
        self.stats.frames += 1


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
    flags, gain, *counts = _SPECTRUM.unpack(body)
    return Spectrum(sensor, sequence, t_us, flags, gain, tuple(counts))


def _key(sensor: int, sequence: int, t_us: int, body: bytes) -> Key:
    page, usage, modifiers, pressed = _KEY.unpack(body)
    return Key(sensor, sequence, t_us, page, usage, modifiers, bool(pressed))


def _contact(sensor: int, sequence: int, t_us: int, body: bytes) -> Contact:
    number, state, position_um, sigma_um, force_mN = _CONTACT.unpack(body)
    return Contact(
        sensor, sequence, t_us, number, state, position_um, sigma_um, force_mN or math.nan
    )


def _text(sensor: int, sequence: int, t_us: int, body: bytes) -> Text:
    return Text(sensor, sequence, t_us, present(_object(body)))


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
    frame.SPECTRUM: (Spectrum, _SPECTRUM.format),
    frame.KEY: (Key, frame.KEY_BODY),
    frame.CONTACT: (Contact, frame.CONTACT_BODY),
}
