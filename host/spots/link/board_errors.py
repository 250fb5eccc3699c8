"""The operating system's errors on a board in words: a board often reports only their numbers."""

import re
from collections.abc import Mapping
from typing import Any

AGAIN = "run this command again"  # end of a text that contains a remedy
# Numbers as in MicroPython's py/mperrno.h. CircuitPython and the ESP32 have another number for a
# timeout, 116.
_WORDS = {
    1: "not permitted",
    2: "no such file",
    5: "input/output error",
    9: "the file is closed",
    11: "try again",
    12: "out of memory",
    13: "access denied",
    16: "the device is busy",
    17: "the file exists",
    19: "no such device",
    20: "not a folder",
    21: "a folder, not a file",
    22: "invalid argument",
    23: "too many open files",
    24: "too many open files",
    27: "the file is too large",
    28: f"the board has a full file system: remove some of your files from it, and {AGAIN}",
    30: f"the board has a read-only file system: reset the board, and {AGAIN}",
    39: "the folder is not empty",
    95: "not supported",
    110: "timeout",
    116: "timeout",
}
# Codes of a `BoardError`: of the firmware, then of this program.
REASONS = {
    "bad_line": "the line is too long, or not printable ASCII",
    "no_command": "the firmware has no such command",
    "no_sensor": "the board has no sensor of this number",
    "bad_value": "an argument of the command is missing or invalid",
    "bad_calibration": "an uploaded calibration is incomplete, damaged, too large or invalid",
    "bad_layout": "an uploaded layout is incomplete, damaged, too large or invalid",
    "busy": "an earlier command still runs",
    "canceled": "the command ended early, because the sensor or the board restarted",
    "no_memory": "too little memory is left on the board, or its reply is too long",
    "no_flash": "the flash of the board cannot be written",
    "no_radio": "the radio is off, or the board has none",
    "by_usb_only": "the command changes who may listen by radio, so it must come by USB",
    "no_bus": "the sensor or another device of the board does not answer",
    "too_dark": "the search for settings found too little light",
    "too_bright": "the search for settings found too much light",
    "no_dark": "no dark frame is stored for an LED that is always on",
    "not_here": "a recording or a remote board cannot execute this command",
    "no_calibration": "the board has no calibration for its settings",
    "too_slow": "the board takes readings too slowly for this application",
    "too_few": "the board sends too few readings",
    "keys_off": "the keys of the board are off",
    "is_keyboard": "the board is a keyboard itself",
    "is_gamepad": "the board is a gamepad itself",
    "led_switched": "the board switches its LED itself",
    "no_id": "the board has no valid id",
    "other_runtime": "the board runs another kind of Python",
    "old_runtime": "the Python of the board is too old",
    "other_board": "the board is of another type",
    "full": "the file system of the board is full",
    "problems": "`spots doctor` has found problems",
}
# The forms of an OSError in replies and tracebacks.
_ERROR = re.compile(
    r"(?:OSError: |error )?\[Errno (\d+)\][^()]*"
    r"|(?:^|OSError: )\((\d+), [^()]*\)$"
    r"|OSError:? (\d+)\b"
    r"|\berror (\d+)\b"
    r"|(?<=failed \()(\d+)(?=\))"
    r"|^(\d+)$"
)


def in_words(text: str) -> str:
    """Replace the number of each OSError in a text of a board by words.

    >>> in_words("the I2C bus failed (5): check the wiring")
    'the I2C bus failed (input/output error): check the wiring'
    >>> in_words("[Errno 19] ENODEV")
    'no such device'
    >>> in_words("OSError: 1000")
    'error 1000 of its operating system'
    """
    return _ERROR.sub(_in_words, text)


def reason_of(reply: Mapping[str, Any]) -> str:
    """Return the code of a reply with an error; empty without a known code."""
    why = reply.get("why")
    return why if isinstance(why, str) and why in REASONS else ""


def _in_words(found: re.Match[str]) -> str:
    number = next(filter(None, found.groups()))
    return _WORDS.get(int(number), f"error {number} of its operating system")
