"""Replies of a board: their types, validated before anyone shows or uses them."""

from __future__ import annotations

from typing import Annotated, Any, TypedDict, cast

import msgspec

from spots_device.smux import CHANNELS

from ..errors import printable

# A reply has at most `frame.TEXT_MAX` bytes on the wire, a published sample less than twice that.
JSON_BYTES_MAX = 4096
_NESTING_MAX = 64

_Number = Annotated[int, msgspec.Meta(ge=0, le=1 << 31)]
_Count = Annotated[int, msgspec.Meta(ge=1, le=1 << 31)]
_Time = Annotated[int, msgspec.Meta(ge=0, lt=1 << 32)]
_Dark = Annotated[list[_Number], msgspec.Meta(min_length=CHANNELS, max_length=CHANNELS)]


class Settings(TypedDict):
    """How a board measures, see docs/protocol.md."""

    plan: list[str]
    exposure_us: _Count
    average: _Count
    gain: _Number
    led_mA: _Number
    strain_ppm: _Number
    keys: _Number
    gamepad: _Number


class Changed(Settings, total=False):
    """The reply to ``set`` and ``auto``: all settings as they are now.

    ``note`` warns of a calibration or a layout that does not hold any more; ``rate_mHz`` is the
    rate to expect, in readings per 1000 s.
    """

    rate_mHz: _Number
    note: str


class Hello(Settings):
    """The reply to ``hello``: which board it is. None is what it does not have."""

    board: str
    runtime: str
    firmware: str
    id: str | None
    length_um: _Count | None
    calibration: str | None
    layout: str | None


class Get(Settings):
    """The reply to ``get``: settings and state."""

    full_scale: _Number
    dark: _Dark
    missed: _Number
    fault: str | None


class DarkFrame(TypedDict):
    """The reply to ``dark``: sums of counts without light."""

    dark: _Dark


class Sync(TypedDict):
    """The reply to ``sync``: the board's time modulo 2**32, and what it streams."""

    t_us: _Time
    stream: list[str] | None


class _Stream(TypedDict):
    stream: list[str]


_SETTINGS: dict[str, object] = {
    "plan": [],
    "exposure_us": 1,
    "average": 1,
    **dict.fromkeys(("gain", "led_mA", "strain_ppm", "keys", "gamepad"), 0),
}
_HELLO: dict[str, object] = {
    **dict.fromkeys(("board", "runtime", "firmware"), "?"),
    **dict.fromkeys(("id", "length_um", "calibration", "layout")),
}
# The full scale is not known before the sensor is there.
_GET: dict[str, object] = {"full_scale": 0, "dark": [0] * CHANNELS, "missed": 0, "fault": None}
# By the name of the command: the type of its reply, and what a board may leave out. Replies to
# other commands have nothing that a program relies on.
_KINDS: dict[str, tuple[Any, dict[str, object]]] = {
    "hello": (Hello, _SETTINGS | _HELLO),
    "get": (Get, _SETTINGS | _GET),
    "set": (Changed, _SETTINGS),
    "auto": (Changed, _SETTINGS),
    "dark": (DarkFrame, {}),
    "sync": (Sync, {"stream": None}),
    "stream": (_Stream, {}),
}


def decoded(data: Any) -> dict[str, Any]:
    """Return a JSON object that anyone may have sent, if it is as small and flat as a board's.

    A parser recurses once a bracket, so they are counted before. Those in strings count, too.

    Parameters
    ----------
    data : bytes or zenoh.ZBytes
        Copied only if it is short enough.

    Raises
    ------
    ValueError
        If it is no JSON object, too long or too deep; msgspec.DecodeError is one.
    """
    if len(data) > JSON_BYTES_MAX:
        raise ValueError(f"a message has at most {JSON_BYTES_MAX} bytes")
    data = bytes(data)
    if data.count(b"[") + data.count(b"{") > _NESTING_MAX:
        raise ValueError(f"a message has at most {_NESTING_MAX} lists and objects")
    return msgspec.json.decode(data, type=dict[str, Any])


def validated(name: str, reply: dict[str, Any]) -> dict[str, Any]:
    """Return a reply whose known keys are there, of the right type and printable.

    Parameters
    ----------
    name : str
        Of the command.
    reply : dict
        Unknown keys stay as they are.

    Returns
    -------
    dict
        The reply, its known values converted and printable.

    Raises
    ------
    msgspec.ValidationError
        If a value is invalid.
    """
    if name not in _KINDS:
        return reply
    kind, defaults = _KINDS[name]
    known: dict[str, Any] = msgspec.convert({**defaults, **reply}, kind)
    return {**reply, **{name: _shown(value) for name, value in known.items()}}


def _shown(value: Any) -> Any:
    if isinstance(value, list):
        return [_shown(one) for one in cast("list[Any]", value)]
    return printable(value) if isinstance(value, str) else value
