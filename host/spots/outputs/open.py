"""Opens the keyboard or the gamepad of this computer, or one that prints."""

from __future__ import annotations

import sys

from ..errors import SpotsError
from .desktop import DesktopKeyboard
from .devices import Gamepad, Keyboard, PrintedGamepad, PrintedKeyboard
from .uinput import UInputGamepad, UInputKeyboard


def open_keyboard(dry_run: bool) -> Keyboard:
    """Return a keyboard of this computer, or one that prints.

    Raises
    ------
    SpotsError
        If a package or a permission is missing; the text says what to do.
    """
    if dry_run:
        return PrintedKeyboard()
    if sys.platform.startswith("linux"):
        return UInputKeyboard()
    return DesktopKeyboard()


def open_gamepad(dry_run: bool) -> Gamepad:
    """Return a gamepad of this computer, or one that prints.

    Raises
    ------
    SpotsError
        If this system has none, or a package or a permission is missing; the text says what to do.
    """
    if dry_run:
        return PrintedGamepad()
    if not sys.platform.startswith("linux"):
        raise SpotsError(
            "a program can be a gamepad on Linux only: let the board be one ('gamepad on'), "
            "or use --dry-run"
        )
    return UInputGamepad()
