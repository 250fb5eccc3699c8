"""Opens a keyboard or gamepad of this computer, or a substitute that only prints."""

import sys
from collections.abc import Callable

from ..errors import RequirementError
from .desktop import DesktopKeyboard
from .devices import Gamepad, Keyboard, PrintedGamepad, PrintedKeyboard
from .uinput import UInputGamepad, UInputKeyboard


def open_keyboard(dry_run: bool, cap: Callable[[int, int], str] | None = None) -> Keyboard:
    """Open a keyboard of this computer or, if `dry_run` is true, a keyboard that only prints.

    Parameters
    ----------
    dry_run : bool
        Whether to print the keys instead of pressing them.
    cap : callable, optional
        ``cap(page, usage) -> str``: the character that is printed for a key; if it is empty, or not
        given, the name of the key is printed.

    Returns
    -------
    Keyboard

    Raises
    ------
    SpotsError
        If a package, a permission, /dev/uinput (on Linux) or a desktop (elsewhere) is missing.
    """
    if dry_run:
        return PrintedKeyboard(cap)
    if sys.platform.startswith("linux"):
        return UInputKeyboard()
    return DesktopKeyboard()


def open_gamepad(dry_run: bool) -> Gamepad:
    """Open a gamepad of this computer or, if `dry_run` is true, a gamepad that only prints.

    Raises
    ------
    RequirementError
        If this system cannot emulate a gamepad, or a package, a permission or /dev/uinput is
        missing.
    """
    if dry_run:
        return PrintedGamepad()
    if not sys.platform.startswith("linux"):
        raise RequirementError(
            "this program can emulate a gamepad only on Linux: let the board be the gamepad "
            "('spots command set gamepad=1'), or use --dry-run"
        )
    return UInputGamepad()
