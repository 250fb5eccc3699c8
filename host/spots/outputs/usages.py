"""Names of keys in the USB HID Usage Tables, on Linux, and in the Python package pynput.

Key names are those of the tables (version 1.5, pages 0x07 and 0x0C), in capitals with underscores.
The character that a key types on an American keyboard is also a name of the key: ``usage_of("1")``
is ``usage_of("ONE")``. The names that other projects use are in ``aliases.txt``.
"""

import re
from collections.abc import Iterator
from pathlib import Path
from typing import NamedTuple

from ..errors import SettingError, did_you_mean

KEYBOARD = 0x07
CONSUMER = 0x0C
# Kinds of actions in the firmware, see `spots_device.keys.layout`.
SYSTEM = 0x08
MOUSE = 0x09
WHEEL = 9
# Bit i of the modifiers in a keyboard report stands for the key with this usage plus i.
MODIFIERS_FROM = 0xE0
MODIFIERS = 8


USAGES_FILE = Path(__file__).with_name("usages.txt")
ALIASES_FILE = Path(__file__).with_name("aliases.txt")
# Usages that a report of a board can contain.
_REPORTED = {
    KEYBOARD: (*range(0x04, 0xDE), *range(MODIFIERS_FROM, MODIFIERS_FROM + MODIFIERS)),
    CONSUMER: range(1, 0x400),
}
_NUMBER = r"(0x[0-9a-f]{1,3}|\d{1,4})"
_RAW = re.compile(rf"usage\s+{_NUMBER}:{_NUMBER}", re.IGNORECASE)
_PREFIXES = ("KC_", "KEY_")  # of QMK and of Linux


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
# What only a board can press, as a USB device of its own: kind and number of the action.
ON_BOARDS = {
    "SYSTEM_POWER_DOWN": (SYSTEM, 0x81),
    "SYSTEM_SLEEP": (SYSTEM, 0x82),
    "SYSTEM_WAKE_UP": (SYSTEM, 0x83),
    "MOUSE_LEFT": (MOUSE, 1),
    "MOUSE_RIGHT": (MOUSE, 2),
    "MOUSE_MIDDLE": (MOUSE, 3),
    "MOUSE_BACK": (MOUSE, 4),
    "MOUSE_FORWARD": (MOUSE, 5),
    "WHEEL_UP": (MOUSE, WHEEL),
    "WHEEL_DOWN": (MOUSE, WHEEL + 1),
    "WHEEL_LEFT": (MOUSE, WHEEL + 2),
    "WHEEL_RIGHT": (MOUSE, WHEEL + 3),
}
_BOARD_NAMES = {action: name for name, action in ON_BOARDS.items()}
# Other names of each key, and Linux's, such as VOLUMEUP for VOLUME_INCREMENT.
ALIASES: dict[str, list[str]] = {
    words[0]: words[1:]
    for words in map(str.split, ALIASES_FILE.read_text("ascii").splitlines())
    if words[0] != "#"
}
_BY_ALIAS = {one.linux.removeprefix("KEY_"): one for one in reversed(USAGES.values())}
_NO_KEYS = ALIASES.pop("-")  # names of other projects for what is no key
_BY_ALIAS |= {alias: _BY_NAME[name] for name, aliases in ALIASES.items() for alias in aliases}
_SIMILAR = {alias: one.name for alias, one in _BY_ALIAS.items()} | {name: name for name in _BY_NAME}
# The keypad types characters of the main keys, too; the main keys take precedence.
_BY_CHARACTER = {
    one.pynput: one
    for one in reversed(USAGES.values())
    if one.page == KEYBOARD and len(one.pynput or "") == 1
}


def usage_of(name: str) -> tuple[int, int]:
    """Return the HID usage page and the usage of a key; or kind and number of `ON_BOARDS`.

    Parameters
    ----------
    name : str
        Name of the key in upper or lower case, such as ``enter``, ``VOL_UP`` or ``/``; or page and
        usage, such as ``usage 12:0x6F``.

    Raises
    ------
    SettingError
        If no key has this name; the message suggests similar names.
    """
    name = str(name)  # a number such as 5 is the key with this digit
    raw = _RAW.fullmatch(name)
    if raw:
        page, usage = (int(number, 0) for number in raw.groups())
        if usage not in _REPORTED.get(page, ()):
            raise SettingError(
                f"a board cannot report '{name}': the page is 7 (0x04 to 0xDD, 0xE0 to 0xE7) or 12 "
                "(1 to 0x3FF)"
            )
        return page, usage
    if name.upper() in ON_BOARDS:
        return ON_BOARDS[name.upper()]
    found = _named(name)
    for prefix in _PREFIXES:
        found = found or (_named(name[len(prefix) :]) if name.upper().startswith(prefix) else None)
    if found is None:
        similar = {} if name.upper() in _NO_KEYS else _SIMILAR
        hint = did_you_mean(name, similar, "'spots keys names WORD' lists names", similar)
        raise SettingError(f"there is no key '{name}': {hint}")
    return found.page, found.usage


def _named(name: str) -> Usage | None:
    upper = name.upper()
    return _BY_NAME.get(upper) or _BY_CHARACTER.get(name.lower()) or _BY_ALIAS.get(upper)


def name_of(page: int, usage: int) -> str:
    """Return the name of a key.

    Parameters
    ----------
    page, usage : int
        HID usage page and usage.

    Returns
    -------
    str
        Name of the key; if it has no name, page and usage as `usage_of` reads them.
    """
    found = USAGES.get((page, usage))
    named = found.name if found else _BOARD_NAMES.get((page, usage))
    return named or f"usage {page}:0x{usage:02X}"


def on_caps(modifiers: int) -> str:
    """Return what keyboards print on the keys of these modifiers, such as ``Ctrl+``."""
    names = "Ctrl", "Shift", "Alt", "GUI", "Ctrl", "Shift", "AltGr", "GUI"
    return "".join(f"{name}+" for i, name in enumerate(names) if modifiers >> i & 1)


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
        If the key or a modifier is unknown.
    """
    modifiers, name = split_chord(text)
    return *usage_of(name), modifier_bits(modifiers)


def split_chord(text: str) -> tuple[list[str], str]:
    """Return the modifiers and the key of a chord as they are written.

    Parameters
    ----------
    text : str
        Modifiers and key, joined by ``+``; the last ``+`` of ``LEFT_SHIFT++`` is the key.
    """
    if len(text) > 1 and text.endswith("++"):
        return text[:-2].split("+"), "+"
    *modifiers, name = text.split("+") if len(text) > 1 else [text]
    return modifiers, name


def modifier_bits(names: list[str]) -> int:
    """Return the bits of modifier keys.

    Parameters
    ----------
    names : list of str
        Names of the keys.

    Raises
    ------
    SettingError
        If a key is unknown or no modifier key.
    """
    bits = 0
    for modifier in names:
        page, usage = usage_of(modifier)
        if not is_modifier(page, usage):
            known = (name_of(KEYBOARD, MODIFIERS_FROM + i) for i in range(MODIFIERS))
            raise SettingError(f"'{modifier}' is not a modifier: use one of {', '.join(known)}")
        bits |= 1 << usage - MODIFIERS_FROM
    return bits
