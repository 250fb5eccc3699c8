"""Output devices of this computer: base classes, and devices that only print.

An open output releases all keys and buttons on every exit path, and when a signal (Ctrl-Z) stops
the process, see `signals`::

    with released_by_signals(), open_keyboard(dry_run=False) as keyboard:
        keyboard.usage(*usage_of("PLAY_PAUSE"), pressed=True)
        keyboard.click(*chord_of("LEFT_CONTROL+C"))

A process that is killed by SIGKILL runs no code. On Linux the kernel then removes the virtual
device and releases its keys.
"""

import time
from collections.abc import Callable
from typing import NamedTuple, Protocol

from spots_device.keys.layout import LIMITS

from ..common.signals import SECTION
from ..errors import SettingError, SpotsError
from .usages import KEYBOARD, MODIFIERS, MODIFIERS_FROM, USAGES, Usage, name_of

TAP_S = LIMITS["tap_ms"][2] / 1000

AXIS_MAX = 32_767  # as in the reports of `spots_device.usb`
BUTTONS = 16


class State(NamedTuple):
    """Axes and buttons of a gamepad, as in the reports of `spots_device.usb`.

    Attributes
    ----------
    x, y : int
        Stick axes, from -32767 to 32767.
    z : int
        Force axis, from 0 to 32767.
    buttons : int
        16 bits, one for each button; bit 0 is button 1.
    """

    x: int
    y: int
    z: int
    buttons: int


REST = State(0, 0, 0, 0)


class Output:
    """Base class of output devices: closing releases all keys and buttons, even after an error.

    Attributes
    ----------
    muted : bool
        Whether the device ignores presses, see `mute`.
    """

    muted = False
    _closed = False

    def __enter__(self):
        SECTION.outputs.add(self)
        return self

    def __exit__(self, *exception) -> None:
        self.close()

    def release(self) -> None:
        """Release all keys or buttons, and centre all axes."""
        raise NotImplementedError

    def mute(self) -> None:
        """Release all keys and buttons, and ignore presses until `signals.resumed` is called."""
        self.muted = True
        self.release()

    def close(self) -> None:
        """Release all keys and buttons, and close the device; idempotent."""
        with SECTION:
            if self._closed:
                return
            self._closed = True
            SECTION.outputs.discard(self)
            try:
                self.release()
            finally:
                self._close()

    def _close(self) -> None:
        pass


class KeySink(Protocol):
    """Receiver of key events, such as the text that is typed."""

    def key(self, page: int, usage: int, modifiers: int, pressed: bool) -> None:
        """Handle a key event.

        Parameters
        ----------
        page, usage : int
            HID usage page and usage of the key, see `usages.usage_of`.
        modifiers : int
            All modifier keys that are down after the event, as bits of a USB keyboard report: bit i
            is the key with the usage `usages.MODIFIERS_FROM` + i. They have their own events, too.
        pressed : bool
            True for a press, False for a release.
        """


class Keyboard(Output):
    """Base class of keyboards; `spots_device.keys.merge` calls `usage` for several keys at once."""

    def __init__(self):
        self._down: list[Usage] = []  # keys that may be pressed on the computer

    def usage(self, page: int, usage: int, modifiers: int = 0, pressed: bool = True) -> None:
        """Press or release a single key.

        Parameters
        ----------
        page, usage : int
            HID usage page and usage of the key, see `usages.usage_of`.
        modifiers : int
            Ignored: each modifier key is pressed and released by its own usage.
        pressed : bool
            True to press, False to release. To press a pressed key, to release a released key, or
            to press a key while this keyboard is muted, has no effect.

        Raises
        ------
        SpotsError
            If this keyboard has no such key, or the device refuses events.
        """
        with SECTION:
            one = self._known(page, usage)
            if pressed and self.muted:
                return
            if pressed == (one in self._down):
                return
            if pressed:
                self._down.append(one)  # before `_set`, so that an exception cannot hide it
                self._set(one, True)
            else:
                self._set(one, False)
                self._down.remove(one)
            self._flush()

    def click(self, page: int, usage: int, modifiers: int, down_s: float = TAP_S) -> None:
        """Press and release a key with its modifiers.

        Parameters
        ----------
        page, usage, modifiers : int
            HID usage page, usage, and bits of the modifier keys, see `usages.chord_of`.
        down_s : float, optional
            Time in s between press and release, during which this function waits. The default is
            that of a tapped key of a strip with keys: games and remote desktops can miss a shorter
            press.

        Raises
        ------
        SpotsError
            If this keyboard has no such key, or the device refuses events.
        """
        bits = [bit for bit in range(MODIFIERS) if modifiers >> bit & 1]
        keys = [*((KEYBOARD, MODIFIERS_FROM + bit) for bit in bits), (page, usage)]
        for key in keys:
            self._known(*key)
        try:
            for key in keys:
                self.usage(*key)
            time.sleep(down_s)
        finally:
            for key in reversed(keys):
                self.usage(*key, pressed=False)

    def release(self) -> None:
        """Release all keys; if the release of a key fails, still release the other keys."""
        failure = None
        with SECTION:
            for one in reversed(list(self._down)):
                try:
                    self._set(one, False)
                    self._down.remove(one)
                except SpotsError as error:
                    failure = error
            self._flush()
        if failure is not None:
            raise failure

    def _known(self, page: int, usage: int) -> Usage:
        if (page, usage) not in USAGES:
            raise SettingError(
                f"this keyboard has no key {name_of(page, usage)}: choose another key"
            )
        self._check(USAGES[page, usage])
        return USAGES[page, usage]

    def _check(self, one: Usage) -> None:
        """Raise SpotsError if the device does not have the key `one`."""

    def _set(self, one: Usage, pressed: bool) -> None:
        raise NotImplementedError

    def _flush(self) -> None:
        pass


class Gamepad(Output):
    """Base class of gamepads: a state is sent only if it differs from the previous state."""

    def __init__(self):
        self._last: State | None = REST

    def update(self, x: int, y: int, z: int, buttons: int) -> None:
        """Set all axes and buttons.

        Parameters
        ----------
        x, y, z, buttons : int
            Values as in `State`.

        Raises
        ------
        SpotsError
            If the device refuses events.
        """
        with SECTION:
            state = REST if self.muted else State(x, y, z, buttons)
            if state != self._last:
                self._last = None  # unknown if sending fails
                self._send(state)
                self._last = state

    def release(self) -> None:
        """Centre all axes and release all buttons."""
        self.update(*REST)

    def _send(self, state: State) -> None:
        raise NotImplementedError


class PrintedKeyboard(Keyboard):
    """Prints a line for each key that is pressed or released: ``cap(page, usage)``, or its name."""

    def __init__(self, cap: Callable[[int, int], str] | None = None):
        super().__init__()
        self._cap = cap

    def _set(self, one, pressed):
        cap = self._cap(one.page, one.usage) if self._cap else ""
        print(f"{'down' if pressed else 'up':4}  {cap or one.name}", flush=True)


class PrintedGamepad(Gamepad):
    """Gamepad that prints a line for each state."""

    def _send(self, state):
        print(line(state), flush=True)


def line(state: State) -> str:
    """Return a gamepad state as a line of text."""
    names = " ".join(str(i + 1) for i in range(BUTTONS) if state.buttons >> i & 1)
    return f"x {state.x:6}  y {state.y:6}  z {state.z:5}  buttons {names or '-'}"
