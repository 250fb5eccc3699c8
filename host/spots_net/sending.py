"""What outlets have in common: rows and values of frames, and addresses to send them to."""

import ipaddress
import math
import re
from contextlib import suppress
from typing import Any

from spots.errors import SettingError
from spots.link.board import Board
from spots.link.frames import Contact, Reading, Spectrum, Touch
from spots.link.lines import of_sensor
from spots.recording.table import VALUES

KINDS = "touch", "contact", "key", "spectrum"  # kinds of frames that outlets send
_FIRST = "sensor", "sequence", "t_us"
# Fields of frames whose names differ from those of their columns, by column.
_FIELDS = {"contrast_log2": "contrast", "brightness_log2": "brightness", "gain_code": "gain"}
# [IPv6 address], or name or IPv4 address; then perhaps a port.
_ADDRESS = re.compile(r"(?:\[([^\[\]]+)\]|([^\s:/\[\]]+))(?::([0-9]{1,5}))?", re.ASCII)
_PORT_MAX = 65_535
_NAME_MAX = 253  # characters of a name in the domain name system
_SHOWN = 60  # characters of an address in an error message


def host_and_port(
    address: str, default: tuple[str, int], what: str, least_port: int = 1
) -> tuple[str, int]:
    """Return host and port of an address such as ``192.168.1.7:9000``, ``[::1]:9000`` or ``host``.

    The port is taken from `default` if it is missing, and both are if the address is empty.
    SettingError if the host cannot be a name or an IP address, or the port is not a number from
    `least_port` to 65535; `what` names the outlet in its sentence.
    """
    if not address:
        return default
    match = _ADDRESS.fullmatch(address)
    host, port = (match[1] or match[2], match[3]) if match else ("", "")
    number = int(port) if port else default[1]
    if not (_is_host(host, in_brackets=bool(match and match[1])) and number >= least_port):
        number = _PORT_MAX + 1
    if number > _PORT_MAX:
        raise SettingError(
            f"{address[:_SHOWN]!r} is not an address for {what}: give HOST:PORT, such as "
            f"192.168.1.7:{default[1]} or [::1]:{default[1]}"
        )
    return host, number


def _is_host(host: str, in_brackets: bool) -> bool:
    with suppress(ValueError):
        return (ipaddress.ip_address(host).version == 6) == in_brackets
    with suppress(UnicodeError):  # a label is empty or too long
        return not in_brackets and 0 < len(host.encode("idna")) <= _NAME_MAX
    return False


def values(frame: Reading) -> dict[str, Any]:
    """Return the values of a frame by the names of the columns of ``spots export``.

    An unknown number is NaN.
    """
    names = (*_FIRST, *VALUES[kind_of(frame)])
    return {name: getattr(frame, _FIELDS.get(name, name)) for name in names}


def row(frame: Reading, time_s: float, arrived_s: float, channels: list[str]) -> dict[str, Any]:
    """Return a frame as a row of ``spots export``, without the values that are unknown.

    The times are in seconds since publishing began. `channels` are the names of the six ADCs'
    channels.
    """
    found = {"time_s": time_s, "arrived_s": arrived_s, **values(frame)}
    if isinstance(frame, Spectrum):
        counts = found.pop("counts")
        found |= {f"counts_{name}": count for name, count in zip(channels, counts)}
    elif isinstance(frame, Touch | Contact):
        where = frame.position_um if isinstance(frame, Touch) else frame.force_mN
        found["known"] = not math.isnan(where)
    return {
        name: value
        for name, value in found.items()
        if not (isinstance(value, float) and math.isnan(value))
    }


def plans(board: Board) -> list[list[str]]:
    """Return the names of the channels of the six ADCs, for each sensor of a board."""
    return [board.command(of_sensor("hello", i))["channels"] for i in board.sensors]


def kind_of(frame: Reading) -> str:
    """Return the name of a frame's table: ``touch``, ``spectrum``, ``key`` or ``contact``."""
    return type(frame).__name__.lower()
