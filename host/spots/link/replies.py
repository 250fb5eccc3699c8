"""What a board replies, made sure of before anyone shows it or counts on it."""

from __future__ import annotations

from typing import Annotated, Any

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


class _Settings(msgspec.Struct):
    plan: list[str] = []
    exposure_us: _Count = 1
    average: _Count = 1
    gain: _Number = 0
    led_mA: _Number = 0
    strain_ppm: _Number = 0
    keys: _Number = 0
    gamepad: _Number = 0


class _Hello(_Settings):
    board: str = "?"
    runtime: str = "?"
    firmware: str = "?"
    id: str | None = None
    length_um: _Count | None = None
    calibration: str | None = None
    layout: str | None = None


class _Get(_Settings):
    full_scale: _Number = 0  # not known before the sensor is there
    dark: _Dark = msgspec.field(default_factory=lambda: [0] * CHANNELS)
    missed: _Number = 0
    fault: str | None = None


class _DarkFrame(msgspec.Struct):
    dark: _Dark


class _Sync(msgspec.Struct):
    t_us: _Time
    stream: list[str] | None = None


class _Stream(msgspec.Struct):
    stream: list[str]


# By the name of the command; the others' replies tell nothing that is counted on.
_KINDS = {
    "hello": _Hello,
    "get": _Get,
    "set": _Settings,
    "auto": _Settings,
    "dark": _DarkFrame,
    "sync": _Sync,
    "stream": _Stream,
}


def decoded(data: Any) -> dict:
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
    return msgspec.json.decode(data, type=dict)


def made_sure(name: str, reply: dict) -> dict:
    """Return a reply in which all that is asked for elsewhere is there and sound.

    Parameters
    ----------
    name : str
        Of the command.
    reply : dict
        A key that is not known is kept as it is.

    Raises
    ------
    msgspec.ValidationError
        If a value is none that a board tells.
    """
    if name not in _KINDS:
        return reply
    known = msgspec.structs.asdict(msgspec.convert(reply, _KINDS[name]))
    return {**reply, **{name: _shown(value) for name, value in known.items()}}


def _shown(value):
    if isinstance(value, list):
        return [_shown(one) for one in value]
    return printable(value) if isinstance(value, str) else value
