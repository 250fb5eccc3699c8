"""Keyboard for macOS and Windows, which uses the Python package pynput.

Keys are identified by their characters, not by their positions: a key stands for the character that
it types on an American keyboard. This keyboard presses the key that types the same character in the
computer's own keyboard layout.
"""

from ..errors import RequirementError, SettingError, pip_install
from .devices import Keyboard
from .usages import Usage


class DesktopKeyboard(Keyboard):
    """Presses keys of this computer on macOS and Windows.

    RequirementError if pynput is missing, or there is no desktop.
    """

    def __init__(self):
        super().__init__()
        try:
            from pynput import keyboard
        except ImportError as error:
            why = "" if error.name == "pynput" else f" ({error})"
            raise RequirementError(
                f"typing on this computer needs pynput and a desktop{why}: "
                f"{pip_install('pynput')}, or use --dry-run to print the keys"
            ) from None
        self._names = keyboard.Key
        self._controller = keyboard.Controller()

    def _check(self, one: Usage) -> None:
        if self._key(one) is None:
            raise SettingError(
                f"the keyboard of this computer has no {one.name}: choose another key"
            )

    def _set(self, one: Usage, pressed: bool) -> None:
        try:
            (self._controller.press if pressed else self._controller.release)(self._key(one))
        except Exception as error:  # the type depends on the desktop
            raise RequirementError(
                f"the desktop refuses the key {one.name} ({error!r}): allow this program to type, "
                "in the settings of the desktop"
            ) from None

    def _key(self, one: Usage):
        if one.pynput is None or len(one.pynput) == 1:
            return one.pynput
        return getattr(self._names, one.pynput, None)
