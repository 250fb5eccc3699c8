"""Virtual keyboard and gamepad for Linux, made with the kernel's uinput and python-evdev."""

import errno
import os
import platform
from collections.abc import Callable
from pathlib import Path

from ..errors import RequirementError, pip_install
from .devices import AXIS_MAX, BUTTONS, Gamepad, Keyboard, State
from .usages import USAGES, Usage

_NODE = "/dev/uinput"
_UINPUT_RULE = 'KERNEL=="uinput", SUBSYSTEM=="misc", OPTIONS+="static_node=uinput", TAG+="uaccess"'
# Package to install. The wheel of evdev-binary needs no compiler, but exists only for x86-64.
_PACKAGE = "evdev-binary" if platform.machine() == "x86_64" else "evdev"


class UInputKeyboard(Keyboard):
    """A virtual keyboard with all keys of `usages`.

    RequirementError if evdev is missing, or /dev/uinput is missing or not writable.
    """

    def __init__(self):
        super().__init__()
        self._evdev = evdev = _import_evdev()
        codes = sorted({evdev.ecodes.ecodes[one.linux] for one in USAGES.values()})
        # With EV_REP the kernel repeats a held key, even without a desktop.
        self._device = _open(evdev, {evdev.ecodes.EV_KEY: codes, evdev.ecodes.EV_REP: ()}, "keys")

    def _set(self, one: Usage, pressed: bool) -> None:
        ecodes = self._evdev.ecodes
        _do(self._device.write, ecodes.EV_KEY, ecodes.ecodes[one.linux], int(pressed))

    def _flush(self) -> None:
        _do(self._device.syn)

    def _close(self) -> None:
        self._device.close()


class UInputGamepad(Gamepad):
    """A virtual gamepad with the same axes and buttons as the gamepad of a board.

    RequirementError if evdev is missing, or /dev/uinput is missing or not writable.
    """

    def __init__(self):
        super().__init__()
        self._evdev = evdev = _import_evdev()
        ecodes = evdev.ecodes
        # AbsInfo: value, min, max, fuzz, flat, resolution.
        lows = {ecodes.ABS_X: -AXIS_MAX, ecodes.ABS_Y: -AXIS_MAX, ecodes.ABS_Z: 0}
        axes = [(axis, evdev.AbsInfo(0, low, AXIS_MAX, 0, 0, 0)) for axis, low in lows.items()]
        # The button codes that the kernel's HID driver uses for a gamepad.
        self._buttons = [ecodes.BTN_GAMEPAD + i for i in range(BUTTONS)]
        events = {ecodes.EV_ABS: axes, ecodes.EV_KEY: self._buttons}
        self._device = _open(evdev, events, "gamepad")

    def _send(self, state: State) -> None:
        ecodes = self._evdev.ecodes
        for code, value in zip((ecodes.ABS_X, ecodes.ABS_Y, ecodes.ABS_Z), state):
            _do(self._device.write, ecodes.EV_ABS, code, value)
        for i, code in enumerate(self._buttons):
            _do(self._device.write, ecodes.EV_KEY, code, state.buttons >> i & 1)
        _do(self._device.syn)

    def _close(self) -> None:
        self._device.close()


def _import_evdev():
    try:
        import evdev
    except ImportError:
        raise RequirementError(
            f"the package evdev is missing: {pip_install(_PACKAGE)}, or use --dry-run"
        ) from None
    return evdev


def _open(evdev, events: dict, name: str):
    try:
        return evdev.UInput(events, name=f"SPOTS {name}", bustype=evdev.ecodes.BUS_VIRTUAL)
    except (evdev.UInputError, OSError) as error:
        raise RequirementError(_why_not(error)) from None


def _why_not(error: Exception) -> str:
    number = getattr(error, "errno", None)
    if number in (errno.ENOENT, errno.ENODEV) or not Path(_NODE).is_char_device():
        return f"there is no {_NODE}: run 'sudo modprobe uinput', or use --dry-run"
    if number == errno.EACCES or not os.access(_NODE, os.W_OK):
        return (
            f"{_NODE} is not writable: put the rule at the end of this message into "
            "/etc/udev/rules.d/60-spots.rules, then run 'sudo udevadm control --reload' and "
            f"'sudo udevadm trigger {_NODE}': {_UINPUT_RULE}"
        )
    return f"cannot create a virtual device with {_NODE} ({error}): use --dry-run"


def _do(function: Callable[..., None], *arguments: int) -> None:
    try:
        function(*arguments)
    except OSError as error:
        raise RequirementError(
            f"{_NODE} refuses events ({error}): start the command again"
        ) from None
