"""Keys by the names of the USB HID Usage Tables, and what each is called elsewhere.

Names follow the tables' (version 1.5, pages 0x07 and 0x0C), in capitals with underscores. A
key that types a character by itself can also be called by it, as an American keyboard has it:
``usage_of("1")`` is ``usage_of("ONE")``.
"""

from __future__ import annotations

import difflib
from collections.abc import Iterator
from pathlib import Path
from typing import NamedTuple

from ..errors import SpotsError

KEYBOARD = 0x07
CONSUMER = 0x0C
# Bit i of the modifiers in a report is the key of this usage + i.
MODIFIERS_FROM = 0xE0
MODIFIERS = 8


class Usage(NamedTuple):
    """One key.

    Attributes
    ----------
    page, usage : int
        As in the HID Usage Tables.
    name : str
        See the module.
    linux : str
        Its name in Linux's input-event-codes.h, as the kernel's HID driver maps it.
    pynput : str or None
        A character, or the name of a member of ``pynput.keyboard.Key``; None if it has none.
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


USAGES: dict[tuple[int, int], Usage] = {
    (one.page, one.usage): one for one in _read(Path(__file__).with_name("usages.txt"))
}
_BY_NAME = {one.name: one for one in USAGES.values()}
# What somebody may mean: Linux calls VOLUME_INCREMENT what most do.
_SIMILAR = {one.linux.removeprefix("KEY_"): one.name for one in USAGES.values()}
_SIMILAR |= {name: name for name in _BY_NAME}
# A keypad has characters of the main keys too; the main keys come first.
_BY_CHARACTER = {
    one.pynput: one
    for one in reversed(USAGES.values())
    if one.page == KEYBOARD and len(one.pynput or "") == 1
}


def usage_of(name: str) -> tuple[int, int]:
    """Return page and usage of a key.

    Parameters
    ----------
    name : str
        In any case, such as ``enter``, ``VOLUME_INCREMENT`` or ``/``.

    Raises
    ------
    SpotsError
        If the key is unknown; the text names similar ones.
    """
    found = _BY_NAME.get(name.upper()) or _BY_CHARACTER.get(name.lower())
    if found is None:
        near = difflib.get_close_matches(name.upper(), _SIMILAR, n=3, cutoff=0.7)
        near = dict.fromkeys(_SIMILAR[one] for one in near)
        hint = f"did you mean {' or '.join(near)}?" if near else "names are such as ENTER or F5"
        raise SpotsError(f"there is no key '{name}': {hint}")
    return found.page, found.usage


def name_of(page: int, usage: int) -> str:
    """Return a key's name; its page and usage as numbers where the table has none.

    Parameters
    ----------
    page, usage : int
        HID usage page and usage.

    Returns
    -------
    str
    """
    found = USAGES.get((page, usage))
    return found.name if found else f"{page:#04x}:{usage:#04x}"


def chord_of(text: str) -> tuple[int, int, int]:
    """Return page, usage and bits of the modifiers of a key with modifiers before it.

    Parameters
    ----------
    text : str
        Such as ``LEFT_SHIFT+A``.

    Raises
    ------
    SpotsError
        If the key or modifier is unknown, or the key takes no modifiers.
    """
    *modifiers, name = text.split("+") if len(text) > 1 else [text]
    bits = 0
    for modifier in modifiers:
        page, usage = usage_of(modifier)
        if page != KEYBOARD or not 0 <= usage - MODIFIERS_FROM < MODIFIERS:
            known = (name_of(KEYBOARD, MODIFIERS_FROM + i) for i in range(MODIFIERS))
            raise SpotsError(f"'{modifier}' is no modifier; there are {', '.join(known)}")
        bits |= 1 << usage - MODIFIERS_FROM
    page, usage = usage_of(name)
    if bits and page != KEYBOARD:
        raise SpotsError(f"'{name}' takes no modifiers")
    return page, usage, bits
