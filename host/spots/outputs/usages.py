"""Keys by the names of the USB HID Usage Tables, and what each is called elsewhere.

Names follow the tables' (version 1.5, pages 0x07 and 0x0C), in capitals with underscores. A
key that types a character by itself can also be called by it, as an American keyboard has it:
``usage_of("1")`` is ``usage_of("ONE")``.
"""

from __future__ import annotations

import difflib
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


# usage, name, Linux's name without KEY_, pynput's
# fmt: off
_KEYBOARD = (
    *((0x04 + i, c, c, c.lower()) for i, c in enumerate("ABCDEFGHIJKLMNOPQRSTUVWXYZ")),
    (0x1E, "ONE", "1", "1"),
    (0x1F, "TWO", "2", "2"),
    (0x20, "THREE", "3", "3"),
    (0x21, "FOUR", "4", "4"),
    (0x22, "FIVE", "5", "5"),
    (0x23, "SIX", "6", "6"),
    (0x24, "SEVEN", "7", "7"),
    (0x25, "EIGHT", "8", "8"),
    (0x26, "NINE", "9", "9"),
    (0x27, "ZERO", "0", "0"),
    (0x28, "ENTER", "ENTER", "enter"),
    (0x29, "ESCAPE", "ESC", "esc"),
    (0x2A, "BACKSPACE", "BACKSPACE", "backspace"),
    (0x2B, "TAB", "TAB", "tab"),
    (0x2C, "SPACEBAR", "SPACE", "space"),
    (0x2D, "MINUS", "MINUS", "-"),
    (0x2E, "EQUALS", "EQUAL", "="),
    (0x2F, "LEFT_BRACKET", "LEFTBRACE", "["),
    (0x30, "RIGHT_BRACKET", "RIGHTBRACE", "]"),
    (0x31, "BACKSLASH", "BACKSLASH", "\\"),
    (0x32, "NON_US_HASH", "BACKSLASH", "#"),  # Linux: one code for both, as no keyboard has both
    (0x33, "SEMICOLON", "SEMICOLON", ";"),
    (0x34, "APOSTROPHE", "APOSTROPHE", "'"),
    (0x35, "GRAVE_ACCENT", "GRAVE", "`"),
    (0x36, "COMMA", "COMMA", ","),
    (0x37, "PERIOD", "DOT", "."),
    (0x38, "FORWARD_SLASH", "SLASH", "/"),
    (0x39, "CAPS_LOCK", "CAPSLOCK", "caps_lock"),
    *((0x3A + i, f"F{i + 1}", f"F{i + 1}", f"f{i + 1}") for i in range(12)),
    (0x46, "PRINT_SCREEN", "SYSRQ", "print_screen"),
    (0x47, "SCROLL_LOCK", "SCROLLLOCK", "scroll_lock"),
    (0x48, "PAUSE", "PAUSE", "pause"),
    (0x49, "INSERT", "INSERT", "insert"),
    (0x4A, "HOME", "HOME", "home"),
    (0x4B, "PAGE_UP", "PAGEUP", "page_up"),
    (0x4C, "DELETE", "DELETE", "delete"),
    (0x4D, "END", "END", "end"),
    (0x4E, "PAGE_DOWN", "PAGEDOWN", "page_down"),
    (0x4F, "RIGHT_ARROW", "RIGHT", "right"),
    (0x50, "LEFT_ARROW", "LEFT", "left"),
    (0x51, "DOWN_ARROW", "DOWN", "down"),
    (0x52, "UP_ARROW", "UP", "up"),
    (0x53, "KEYPAD_NUM_LOCK", "NUMLOCK", "num_lock"),
    (0x54, "KEYPAD_FORWARD_SLASH", "KPSLASH", "/"),
    (0x55, "KEYPAD_ASTERISK", "KPASTERISK", "*"),
    (0x56, "KEYPAD_MINUS", "KPMINUS", "-"),
    (0x57, "KEYPAD_PLUS", "KPPLUS", "+"),
    (0x58, "KEYPAD_ENTER", "KPENTER", "enter"),
    (0x59, "KEYPAD_ONE", "KP1", "1"),
    (0x5A, "KEYPAD_TWO", "KP2", "2"),
    (0x5B, "KEYPAD_THREE", "KP3", "3"),
    (0x5C, "KEYPAD_FOUR", "KP4", "4"),
    (0x5D, "KEYPAD_FIVE", "KP5", "5"),
    (0x5E, "KEYPAD_SIX", "KP6", "6"),
    (0x5F, "KEYPAD_SEVEN", "KP7", "7"),
    (0x60, "KEYPAD_EIGHT", "KP8", "8"),
    (0x61, "KEYPAD_NINE", "KP9", "9"),
    (0x62, "KEYPAD_ZERO", "KP0", "0"),
    (0x63, "KEYPAD_PERIOD", "KPDOT", "."),
    (0x64, "NON_US_BACKSLASH", "102ND", None),
    (0x65, "APPLICATION", "COMPOSE", "menu"),
    (0x66, "POWER", "POWER", None),
    (0x67, "KEYPAD_EQUALS", "KPEQUAL", "="),
    *((0x68 + i, f"F{i + 13}", f"F{i + 13}", f"f{i + 13}") for i in range(12)),
    (0xE0, "LEFT_CONTROL", "LEFTCTRL", "ctrl_l"),
    (0xE1, "LEFT_SHIFT", "LEFTSHIFT", "shift_l"),
    (0xE2, "LEFT_ALT", "LEFTALT", "alt_l"),
    (0xE3, "LEFT_GUI", "LEFTMETA", "cmd_l"),
    (0xE4, "RIGHT_CONTROL", "RIGHTCTRL", "ctrl_r"),
    (0xE5, "RIGHT_SHIFT", "RIGHTSHIFT", "shift_r"),
    (0xE6, "RIGHT_ALT", "RIGHTALT", "alt_r"),
    (0xE7, "RIGHT_GUI", "RIGHTMETA", "cmd_r"),
)
_CONSUMER = (
    (0x06F, "DISPLAY_BRIGHTNESS_INCREMENT", "BRIGHTNESSUP", None),
    (0x070, "DISPLAY_BRIGHTNESS_DECREMENT", "BRIGHTNESSDOWN", None),
    (0x0B0, "PLAY", "PLAY", None),
    (0x0B2, "RECORD", "RECORD", None),
    (0x0B3, "FAST_FORWARD", "FASTFORWARD", None),
    (0x0B4, "REWIND", "REWIND", None),
    (0x0B5, "SCAN_NEXT_TRACK", "NEXTSONG", "media_next"),
    (0x0B6, "SCAN_PREVIOUS_TRACK", "PREVIOUSSONG", "media_previous"),
    (0x0B7, "STOP", "STOPCD", "media_stop"),
    (0x0B8, "EJECT", "EJECTCD", "media_eject"),
    (0x0CD, "PLAY_PAUSE", "PLAYPAUSE", "media_play_pause"),
    (0x0E2, "MUTE", "MUTE", "media_volume_mute"),
    (0x0E9, "VOLUME_INCREMENT", "VOLUMEUP", "media_volume_up"),
    (0x0EA, "VOLUME_DECREMENT", "VOLUMEDOWN", "media_volume_down"),
    (0x183, "AL_CONSUMER_CONTROL_CONFIGURATION", "CONFIG", None),
    (0x18A, "AL_EMAIL_READER", "MAIL", None),
    (0x192, "AL_CALCULATOR", "CALC", None),
    (0x194, "AL_LOCAL_MACHINE_BROWSER", "FILE", None),
    (0x196, "AL_INTERNET_BROWSER", "WWW", None),
    (0x21A, "AC_UNDO", "UNDO", None),
    (0x21B, "AC_COPY", "COPY", None),
    (0x21C, "AC_CUT", "CUT", None),
    (0x21D, "AC_PASTE", "PASTE", None),
    (0x221, "AC_SEARCH", "SEARCH", None),
    (0x223, "AC_HOME", "HOMEPAGE", None),
    (0x224, "AC_BACK", "BACK", None),
    (0x225, "AC_FORWARD", "FORWARD", None),
    (0x226, "AC_STOP", "STOP", None),
    (0x227, "AC_REFRESH", "REFRESH", None),
    (0x22A, "AC_BOOKMARKS", "BOOKMARKS", None),
    (0x22D, "AC_ZOOM_IN", "ZOOMIN", None),
    (0x22E, "AC_ZOOM_OUT", "ZOOMOUT", None),
)
# fmt: on

USAGES: dict[tuple[int, int], Usage] = {
    (page, usage): Usage(page, usage, name, "KEY_" + linux, pynput)
    for page, rows in ((KEYBOARD, _KEYBOARD), (CONSUMER, _CONSUMER))
    for usage, name, linux, pynput in rows
}
_BY_NAME = {one.name: one for one in USAGES.values()}
# What somebody may mean: Linux calls VOLUME_INCREMENT what most do.
_SIMILAR = {one.linux.removeprefix("KEY_"): one.name for one in USAGES.values()}
_SIMILAR |= {name: name for name in _BY_NAME}
# A keypad has characters of the main keys too; the main keys come first.
_BY_CHARACTER: dict[str, Usage] = {}
for _one in USAGES.values():
    if _one.page == KEYBOARD and _one.pynput is not None and len(_one.pynput) == 1:
        _BY_CHARACTER.setdefault(_one.pynput, _one)


def usage_of(name: str) -> tuple[int, int]:
    """Return page and usage of a key.

    Parameters
    ----------
    name : str
        In any case, such as ``enter``, ``VOLUME_INCREMENT`` or ``/``.

    Raises
    ------
    SpotsError
        If there is no such key; the text names similar ones.
    """
    found = _BY_NAME.get(name.upper()) or _BY_CHARACTER.get(name.lower())
    if found is None:
        near = difflib.get_close_matches(name.upper(), _SIMILAR, n=3, cutoff=0.7)
        near = dict.fromkeys(_SIMILAR[one] for one in near)
        hint = f"did you mean {' or '.join(near)}?" if near else "names are such as ENTER or F5"
        raise SpotsError(f"there is no key '{name}': {hint}")
    return found.page, found.usage


def name_of(page: int, usage: int) -> str:
    """Return a key's name, or its numbers if it has none here."""
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
        If there is no such key or modifier, or the key takes none.
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
