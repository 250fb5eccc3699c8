"""Names of keys in the USB HID Usage Tables, on Linux, and in the Python package pynput.

Key names are those of the tables (version 1.5, pages 0x07 and 0x0C), in capitals with underscores.
The character that a key types on an American keyboard is also a name of the key: ``usage_of("1")``
is ``usage_of("ONE")``.
"""

from collections.abc import Iterator
from pathlib import Path
from typing import NamedTuple

from ..errors import SpotsError, did_you_mean

KEYBOARD = 0x07
CONSUMER = 0x0C
# Bit i of the modifiers in a keyboard report stands for the key with this usage plus i.
MODIFIERS_FROM = 0xE0
MODIFIERS = 8


USAGES_FILE = Path(__file__).with_name("usages.txt")


class Usage(NamedTuple):
    """A key of the USB HID Usage Tables, with its names on Linux and in pynput.

    Attributes
    ----------
    page, usage : int
        HID usage page and usage.
    name : str
        Name in the HID Usage Tables, in capitals with underscores.
    linux : str
        Name of the key's code in Linux's input-event-codes.h, as Linux's HID driver assigns it.
    pynput : str or None
        Character of the key, or name of a member of ``pynput.keyboard.Key``; None if pynput has no
        such key.
    """

    page: int
    usage: int
    name: str
    linux: str
    pynput: str | None


def _read(path: Path) -> Iterator[Usage]:
    for line in path.read_text("ascii").splitlines():
        if not line.startswith("#"):
            page, usage, name, linux, *pynput = line.split()
            yield Usage(int(page, 16), int(usage, 16), name, linux, pynput[0] if pynput else None)


USAGES: dict[tuple[int, int], Usage] = {(one.page, one.usage): one for one in _read(USAGES_FILE)}
_BY_NAME = {one.name: one for one in USAGES.values()}
# For suggestions: Linux names are common, such as VOLUMEUP for VOLUME_INCREMENT.
_SIMILAR = {one.linux.removeprefix("KEY_"): one.name for one in USAGES.values()}
_SIMILAR |= {name: name for name in _BY_NAME}
# The keypad types characters of the main keys, too; the main keys take precedence.
_BY_CHARACTER = {
    one.pynput: one
    for one in reversed(USAGES.values())
    if one.page == KEYBOARD and len(one.pynput or "") == 1
}


def usage_of(name: str) -> tuple[int, int]:
    """Return the HID usage page and the usage of a key.

    Parameters
    ----------
    name : str
        Name of the key in upper or lower case, such as ``enter``, ``VOLUME_INCREMENT`` or ``/``.

    Raises
    ------
    SpotsError
        If no key has this name; the message suggests similar names.
    """
    found = _BY_NAME.get(name.upper()) or _BY_CHARACTER.get(name.lower())
    if found is None:
        hint = did_you_mean(name, _SIMILAR, "use a name such as ENTER or F5", _SIMILAR)
        raise SpotsError(f"there is no key '{name}': {hint}")
    return found.page, found.usage


def name_of(page: int, usage: int) -> str:
    """Return the name of a key.

    Parameters
    ----------
    page, usage : int
        HID usage page and usage.

    Returns
    -------
    str
        Name of the key; if it has no name, its page and usage as hexadecimal numbers.
    """
    found = USAGES.get((page, usage))
    return found.name if found else f"{page:#04x}:{usage:#04x}"


def is_modifier(page: int, usage: int) -> bool:
    """Return whether a key is a modifier key.

    Parameters
    ----------
    page, usage : int
        HID usage page and usage.

    Returns
    -------
    bool
    """
    return page == KEYBOARD and 0 <= usage - MODIFIERS_FROM < MODIFIERS


def chord_of(text: str) -> tuple[int, int, int]:
    """Return the HID usage page, usage and modifier bits of a key with modifiers.

    Parameters
    ----------
    text : str
        Modifiers and key, joined by ``+``, such as ``LEFT_SHIFT+A``.

    Raises
    ------
    SpotsError
        If the key or a modifier is unknown, or a media key (HID page 0x0C) has modifiers.
    """
    *modifiers, name = text.split("+") if len(text) > 1 else [text]
    bits = 0
    for modifier in modifiers:
        page, usage = usage_of(modifier)
        if not is_modifier(page, usage):
            known = (name_of(KEYBOARD, MODIFIERS_FROM + i) for i in range(MODIFIERS))
            raise SpotsError(f"'{modifier}' is not a modifier: use one of {', '.join(known)}")
        bits |= 1 << usage - MODIFIERS_FROM
    page, usage = usage_of(name)
    if bits and page != KEYBOARD:
        raise SpotsError(f"'{name}' cannot have modifiers: remove them")
    return page, usage, bits
