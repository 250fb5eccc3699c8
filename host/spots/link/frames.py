"""Frames: what a board sends, and what a recorder adds; `decoder` makes them from bytes."""

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, NamedTuple, Union

from spots_device.fingers import contacts as fingers
from spots_device.reading import decode, frame
from spots_device.sensor.smux import CHANNELS

from ..common.certainty import Certainty

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
    sigma_um : float
        Standard deviation of the position due to noise, in um. NaN if the position is unknown, or
        if the calibration of the board is unknown or has no spectra. Errors of the calibration and
        drift are not included.

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
    sigma_um: float = math.nan

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


def with_sigma(touch: Touch, certainties: Mapping[int, Certainty]) -> Touch:
    """Return a touch with its `sigma_um`, from the certainty of its sensor."""
    certainty = certainties.get(touch.sensor)
    if certainty is None or math.isnan(touch.position_um + touch.brightness):
        return touch
    sigma_um = certainty.sigma_of(touch.position_um, touch.brightness)
    return touch._replace(sigma_um=round(sigma_um, 1))


class Spectrum(NamedTuple):
    """The six raw counts of a reading, and what the board subtracts from them.

    Attributes
    ----------
    sensor, sequence, t_us, flags, time_s
        See `Touch`.
    gain : int
        Code of the gain register, 0 to 10 for 0.5x to 512x.
    counts : tuple of int
        Counts of ADC 0 to 5. The board's setting ``channels`` names the channel of each ADC.
    taken_off_q6 : tuple of int
        Light that the reading subtracts from the counts, in 1/64 count: dark frame, baseline, and
        light that sticks. 0 in a recording of protocol 2.
    temperature_mC : int
        Temperature of the board for which the reading uses the calibration, in 0.001 degrees
        Celsius; `frame.UNKNOWN_MC` if unknown.
    context : int
        Bits `frame.CHANGING` and `frame.TWO`: the ambient light changes, keys or contacts have seen
        two fingers.

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
    taken_off_q6: tuple[int, ...] = (0,) * CHANNELS
    temperature_mC: int = frame.UNKNOWN_MC
    context: int = 0


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
