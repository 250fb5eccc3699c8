"""The operating system's errors on a board in words: a board often reports only their numbers."""

import re

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

    Parameters
    ----------
    text : str
        Error message of the board, or the last line of a traceback.

    Returns
    -------
    str

    Examples
    --------
    >>> in_words("the I2C bus failed (5): check the wiring")
    'the I2C bus failed (input/output error): check the wiring'
    >>> in_words("[Errno 19] ENODEV")
    'no such device'
    >>> in_words("OSError: 1000")
    'error 1000 of its operating system'
    """
    return _ERROR.sub(_in_words, text)


def _in_words(found: re.Match[str]) -> str:
    number = next(filter(None, found.groups()))
    return _WORDS.get(int(number), f"error {number} of its operating system")
