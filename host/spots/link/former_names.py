"""Former names on the wire: commands, settings, and values of replies in older recordings.

Recordings contain the replies of the firmware that made them. The table is here and not in the
firmware, because a board has little memory.
"""

from collections.abc import Mapping
from typing import Any

from ..errors import SettingError

_COMMANDS = {"auto": "autoexpose", "rest": "tare"}
_SETTINGS = {"plan": "channels"}
_VALUES = {"rest": "baseline", **_SETTINGS}


def check(line: str) -> None:
    """Raise SettingError if a command or a setting in it has a former name."""
    command, *words = line.split()
    names = [word.partition("=")[0] for word in words] if command == "set" else [command]
    known = _SETTINGS if command == "set" else _COMMANDS
    for name in names:
        if name in known:
            raise SettingError(f"'{name}' is now '{known[name]}': send '{known[name]}'")


def present(reply: Mapping[str, Any]) -> dict[str, Any]:
    """Return a reply (or log line) with the present names of its command and its values."""
    found = {_VALUES.get(name, name): value for name, value in reply.items()}
    command = found.get("re")
    if isinstance(command, str):  # from a damaged file, it may be anything
        found["re"] = _COMMANDS.get(command, command)
    return found
