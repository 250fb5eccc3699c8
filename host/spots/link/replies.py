"""Types of a board's replies, and their validation."""

from typing import Annotated, Any, TypedDict, cast

import msgspec

from spots_device.sensor.smux import CHANNELS

from ..errors import printable
from .board_errors import in_words

# Longest JSON text from another machine. A board's reply has up to 888 bytes (`frame.TEXT_MAX`); a
# published sample has less than twice that.
JSON_BYTES_MAX = 4096
_NESTING_MAX = 64  # largest number of opening brackets in such a text

_Number = Annotated[int, msgspec.Meta(ge=0, le=1 << 31)]
_Count = Annotated[int, msgspec.Meta(ge=1, le=1 << 31)]
_Time = Annotated[int, msgspec.Meta(ge=0, lt=1 << 32)]
_Dark = Annotated[list[_Number], msgspec.Meta(min_length=CHANNELS, max_length=CHANNELS)]

_CROSS_MAX = 1 << 28
_Cross = Annotated[
    list[Annotated[int, msgspec.Meta(ge=-_CROSS_MAX, le=_CROSS_MAX)]],
    msgspec.Meta(min_length=3, max_length=3),
]


class Settings(TypedDict):
    """Settings of a board, see docs/extend/commands.md.

    ``led`` is the way in which the LED is connected, such as "ldr".
    """

    channels: list[str]
    exposure_us: _Count
    average: _Count
    gain: _Number
    led: str
    led_mA: _Number
    strain_ppm: _Number
    mains_hz: _Number
    keys: _Number
    gamepad: _Number


class Changed(Settings, total=False):
    """The reply to ``set`` and ``autoexpose``: all settings after the change.

    ``note`` is only present as a warning that the calibration is not used, or that keys or gamepad
    do not work; ``why`` is then "needs_reboot" if ``save`` and ``reboot`` are all that it takes.
    ``rate_mHz`` is the rate that exposure and ``average`` allow, in readings per
    1000 s; `Board.rate_hz` is what arrives.
    """

    rate_mHz: _Number
    note: str
    why: str


class Hello(Settings):
    """The reply to ``hello``: the board's identity and settings.

    ``id`` is None if the board has no id; ``layout`` is None if it uses the default layout. If it
    has no calibration that is valid at its settings, ``length_um``, ``decay``, ``relative_force``,
    ``presser`` and ``calibration`` are None. ``presser`` is also None if it is unknown. ``cross``
    is None if the calibration has no cross-sensitivity, see
    `spots_device.reading.calibration.Calibration.cross`. ``boot`` has a sentence for each fault at
    the start of the board, such as a damaged file.
    """

    board: str
    runtime: str
    firmware: str
    id: str | None
    length_um: _Count | None
    decay: _Count | None
    cross: _Cross | None
    relative_force: bool | None
    presser: str | None
    calibration: str | None
    layout: str | None
    boot: list[str]


class Get(Settings):
    """The reply to ``get``: the board's settings and state, see docs/extend/commands.md.

    ``full_scale`` is the largest possible count. ``dark`` is the dark frame, see `DarkFrame`.
    ``missed`` is the number of missed samples. ``fault`` is the reason why the sensor does not
    answer; None if it answers.
    """

    full_scale: _Number
    dark: _Dark
    missed: _Number
    fault: str | None


class DarkFrame(TypedDict):
    """The reply to ``dark``: a list of the six mean counts without the LED, each times 64."""

    dark: _Dark


class Sync(TypedDict):
    """The reply to ``sync``: the board's time and its streams.

    ``t_us`` is the board's time in us, modulo 2**32. ``stream`` has the kinds of frames that the
    board streams; None if the firmware does not report them.
    """

    t_us: _Time
    stream: list[str] | None


class _Stream(TypedDict):
    stream: list[str]


# Defaults of missing keys.
_SETTINGS: dict[str, object] = dict.fromkeys(Settings.__annotations__, 0)
_SETTINGS.update(channels=[], exposure_us=1, average=1, led="ldr")
_HELLO: dict[str, object] = {**dict.fromkeys(Hello.__annotations__), **_SETTINGS}
_HELLO.update(board="?", runtime="?", firmware="?", boot=[])
# A full scale of 0 is unknown: the sensor has not answered yet.
_GET: dict[str, object] = dict.fromkeys(Get.__annotations__, 0)
_GET.update(_SETTINGS, dark=[0] * CHANNELS, fault=None)
_WORDED = "fault", "note"  # values that may contain an OSError of the board
# By command: the type of its reply, and the defaults of missing keys. Replies to other commands are
# not validated, because no program depends on them.
_KINDS: dict[str, tuple[Any, dict[str, object]]] = {
    "hello": (Hello, _HELLO),
    "get": (Get, _GET),
    "set": (Changed, _SETTINGS),
    "autoexpose": (Changed, _SETTINGS),
    "dark": (DarkFrame, {}),
    "sync": (Sync, {"stream": None}),
    "stream": (_Stream, {}),
}


def decoded(data: Any) -> dict[str, Any]:
    """Decode a JSON object from an untrusted sender; ValueError if it is invalid or too long.

    Opening brackets are counted before parsing, because the parser recurses at each bracket. A
    message of Zenoh is copied only if it is at most `JSON_BYTES_MAX` bytes long.
    """
    if len(data) > JSON_BYTES_MAX:
        raise ValueError(f"a message must have at most {JSON_BYTES_MAX} bytes")
    data = bytes(data)
    if data.count(b"[") + data.count(b"{") > _NESTING_MAX:
        raise ValueError(f"a message must have at most {_NESTING_MAX} lists and objects")
    return msgspec.json.decode(data, type=dict[str, Any])


def validated(name: str, reply: dict[str, Any]) -> dict[str, Any]:
    """Validate a reply, and add the defaults of missing keys; unknown keys are allowed.

    In the values of the known keys, control characters are escaped, and the numbers of a board's
    errors are replaced by words. msgspec.ValidationError if a value is invalid.
    """
    if name not in _KINDS:
        return reply
    kind, defaults = _KINDS[name]
    known: dict[str, Any] = msgspec.convert({**defaults, **reply}, kind)
    shown = {name: _shown(value) for name, value in known.items()}
    worded = {name: in_words(shown[name]) for name in _WORDED if isinstance(shown.get(name), str)}
    return {**reply, **shown, **worded}


def _shown(value: Any) -> Any:
    if isinstance(value, list):
        return [_shown(one) for one in cast("list[Any]", value)]
    return printable(value) if isinstance(value, str) else value
