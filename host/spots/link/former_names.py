"""Former names on the wire: commands, and values of replies in older recordings.

Recordings contain the replies of the firmware that made them. The table is here and not in the
firmware, because a board has little memory.
"""

from collections.abc import Mapping
from typing import Any

from ..errors import SettingError

_COMMANDS = {"auto": "autoexpose", "rest": "tare"}
_VALUES = {"rest": "baseline"}


def check(line: str) -> None:
    """Raise SettingError if a command has a former name, so that a board need not know it."""
    name = line.split()[0]
    if name in _COMMANDS:
        raise SettingError(f"'{name}' is now '{_COMMANDS[name]}': send '{_COMMANDS[name]}'")


def present(reply: Mapping[str, Any]) -> dict[str, Any]:
    """Return a reply (or log line) with the present names of its command and its values."""
    found = {_VALUES.get(name, name): value for name, value in reply.items()}
    command = found.get("re")
    if isinstance(command, str):  # from a damaged file, it may be anything
        found["re"] = _COMMANDS.get(command, command)
    return found
