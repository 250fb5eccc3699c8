"""Lines of commands: which strip of a board a command concerns."""

import re

_OF_ALL = "save", "reboot", "sync"  # commands for the whole board
# The first line of an upload names the sensor for all of its lines.
_UPLOADED = re.compile(r"(cal|layout) (?!(begin|clear)\b)")


def of_sensor(line: str, sensor: int) -> str:
    """Append ``sensor=N`` to a command, unless N is 0, which every command is for without it."""
    return f"{line} sensor={sensor}" if sensor else line


def addressed(line: str, sensor: int) -> str:
    """Add the number of a sensor to a command if the command concerns a single strip.

    In an upload, the first line names the sensor for all its lines; the others stay unchanged.
    """
    if line.partition(" ")[0] in _OF_ALL or _UPLOADED.match(line):
        return line
    return of_sensor(line, sensor)
