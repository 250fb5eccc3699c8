"""What a board tells of itself, made sure of before anyone shows it or counts on it."""

from __future__ import annotations

from typing import Annotated

import msgspec

from .errors import printable

_Number = Annotated[int, msgspec.Meta(ge=0, le=1 << 31)]
_Count = Annotated[int, msgspec.Meta(ge=1, le=1 << 31)]


class _Hello(msgspec.Struct):
    board: str = "?"
    runtime: str = "?"
    firmware: str = "?"
    id: str | None = None
    plan: list[str] = []
    exposure_us: _Count = 1
    average: _Count = 1
    gain: _Number = 0
    led_mA: _Number = 0
    strain_ppm: _Number = 0
    keys: _Number = 0
    gamepad: _Number = 0
    length_um: _Count | None = None
    calibration: str | None = None
    layout: str | None = None


def made_sure(reply: dict) -> dict:
    """Return a reply to ``hello`` in which all that is asked for elsewhere is there and sound.

    Parameters
    ----------
    reply : dict
        A key that is not known is kept as it is.

    Raises
    ------
    msgspec.ValidationError
        If a value is none that a board tells.
    """
    known = msgspec.structs.asdict(msgspec.convert(reply, _Hello))
    return {**reply, **{name: _shown(value) for name, value in known.items()}}


def _shown(value):
    if isinstance(value, list):
        return [_shown(one) for one in value]
    return printable(value) if isinstance(value, str) else value
