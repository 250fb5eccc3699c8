"""Output devices of this computer: keyboard and gamepad; here those that only print.

An open output releases everything on every exit path and when the process stops, see `signals`::

    with released_by_signals(), open_keyboard(dry_run=False) as keyboard:
        keyboard.key(*usage_of("PLAY_PAUSE"), modifiers=0, pressed=True)

A process that is killed outright (SIGKILL, a power cut) runs no such line. On Linux the kernel
then destroys the virtual device with its last file handle and releases what it held.
"""

from __future__ import annotations

import functools
from collections.abc import Callable, Iterator
from typing import NamedTuple, Protocol

from ..errors import SpotsError
from ..signals import SECTION
from .usages import KEYBOARD, MODIFIERS, MODIFIERS_FROM, USAGES, Usage, name_of

AXIS_MAX = 32_767  # as in the reports of `spots_device.hid`
BUTTONS = 16


class State(NamedTuple):
    """Axes and buttons of a gamepad, as in the reports of `spots_device.hid`.

    Attributes
    ----------
    x, y : int
        -32767 to 32767.
    z : int
        0 to 32767.
    buttons : int
        Bit 0 is button 1; 16 bits.
    """

    x: int
    y: int
    z: int
    buttons: int


REST = State(0, 0, 0, 0)


class Output:
    """A device that releases everything when it is closed, also by an exception.

    Attributes
    ----------
    muted : bool
        Whether it takes releases alone, see `mute`.
    """

    muted = False
    _closed = False

    def __enter__(self):
        SECTION.outputs.add(self)
        return self

    def __exit__(self, *exception) -> None:
        self.close()

    def release(self) -> None:
        """Release everything."""
        raise NotImplementedError

    def mute(self) -> None:
        """Release everything, and press nothing until `signals.resumed` unmutes it."""
        self.muted = True
        self.release()

    def close(self) -> None:
        """Release everything and close the device; idempotent."""
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
    """What key events go to."""

    def key(self, page: int, usage: int, modifiers: int, pressed: bool) -> None:
        """Take a key event.

        Parameters
        ----------
        page, usage : int
            As in the HID Usage Tables, see `usages.usage_of`.
        modifiers : int
            Bits as in a USB keyboard report.
        pressed : bool
            Whether the key goes down, not up.
        """


class Keyboard(Output):
    """Key events in; each key and modifier goes down and up once, however many want it."""

    def __init__(self):
        self._held: dict[tuple[int, int], int] = {}  # keys, and the modifiers of each
        self._down: list[Usage] = []  # all that the computer may know of as pressed

    def key(self, page: int, usage: int, modifiers: int, pressed: bool) -> None:
        """Take a key event.

        Parameters
        ----------
        page, usage : int
            As in the HID Usage Tables, see `usages.usage_of`.
        modifiers : int
            As in a USB keyboard report: they go down before the key, and up with it unless
            another key holds them. What is given with an up does not matter.
        pressed : bool
            Whether it goes down. A key that is down does not go down again.

        Raises
        ------
        SpotsError
            If the key is unknown here, or the device no longer takes events.
        """
        key = (page, usage)
        with SECTION:
            if pressed == (key in self._held) or (pressed and self.muted):
                return
            if pressed:
                for one in self._physical(key, modifiers):
                    self._check(one)
                self._held[key] = modifiers
            else:
                del self._held[key]
            self._apply()

    def release(self) -> None:
        """Release all keys; one that fails does not keep the others down."""
        with SECTION:
            self._held.clear()
            self._apply()

    def _apply(self) -> None:
        wanted = dict.fromkeys(
            one for key, modifiers in self._held.items() for one in self._physical(key, modifiers)
        )
        failure = None
        for one in [one for one in reversed(self._down) if one not in wanted]:
            try:
                self._set(one, False)
                self._down.remove(one)
            except SpotsError as error:
                failure = error
        for one in wanted:
            if one not in self._down:
                self._down.append(one)  # first: an exception in between must not hide it
                self._set(one, True)
        self._flush()
        if failure is not None:
            raise failure

    def _physical(self, key: tuple[int, int], modifiers: int) -> Iterator[Usage]:
        for bit in range(MODIFIERS):
            if modifiers >> bit & 1:
                yield USAGES[KEYBOARD, MODIFIERS_FROM + bit]
        if key not in USAGES:
            raise SpotsError(f"no keyboard here has a key {name_of(*key)}: choose another")
        yield USAGES[key]

    def _check(self, one: Usage) -> None:
        """Raise SpotsError if this device has no such key."""

    def _set(self, one: Usage, pressed: bool) -> None:
        raise NotImplementedError

    def _flush(self) -> None:
        pass


class Gamepad(Output):
    """States in; only what changes goes out."""

    def __init__(self):
        self._last: State | None = REST

    def update(self, x: int, y: int, z: int, buttons: int) -> None:
        """Take all axes and buttons.

        Parameters
        ----------
        x, y, z, buttons : int
            In the ranges of `State`.

        Raises
        ------
        SpotsError
            If the device takes no events any more.
        """
        with SECTION:
            state = REST if self.muted else State(x, y, z, buttons)
            if state != self._last:
                self._last = None  # what the computer knows is unknown until it is sent
                self._send(state)
                self._last = state

    def release(self) -> None:
        """Centre all axes and release all buttons."""
        self.update(*REST)

    def _send(self, state: State) -> None:
        raise NotImplementedError


_print = functools.partial(print, flush=True)


class PrintedKeyboard(Keyboard):
    """Prints a line for each key that goes down or up.

    Parameters
    ----------
    write : callable
        Takes the line.
    """

    def __init__(self, write: Callable[[str], None] = _print):
        super().__init__()
        self._write = write

    def _set(self, one, pressed):
        self._write(f"{'down' if pressed else 'up':4}  {one.name}")


class PrintedGamepad(Gamepad):
    """Prints a line for each state.

    Parameters
    ----------
    write : callable
        Takes the line.
    """

    def __init__(self, write: Callable[[str], None] = _print):
        super().__init__()
        self._write = write

    def _send(self, state):
        self._write(line(state))


def line(state: State) -> str:
    """Return a state as a line of text."""
    names = " ".join(str(i + 1) for i in range(BUTTONS) if state.buttons >> i & 1)
    return f"x {state.x:6}  y {state.y:6}  z {state.z:5}  buttons {names or '-'}"
