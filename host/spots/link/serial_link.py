"""A serial port as a link: read, write, close, and the time by which its bytes arrive."""

from __future__ import annotations

import errno
import sys
import time
from collections.abc import Callable
from typing import Any, Protocol

import serial
from serial.tools import list_ports

from ..errors import PortLostError, RefusedError, SpotsError
from .ports import no_port

try:
    import termios
except ImportError:  # Windows has none
    termios = None
_FAILURES = (serial.SerialException, OSError, *([termios.error] if termios else []))

WRITE_TIMEOUT_S = 2.0
_CHUNK = 4096  # bytes of a socket at once


def takes_nothing(port: str) -> str:
    """Return what there is to say of a port that took no bytes for so long."""
    return f"{port} takes no data: replug the board"


class Link(Protocol):
    """Bytes to and from a board. Owns no protocol logic."""

    @property
    def name(self) -> str:
        """Name of the port."""
        ...

    def now_s(self) -> float:
        """Return the host's time by this link's clock."""
        ...

    def read(self, timeout_s: float) -> bytes:
        """Return what has arrived, waiting up to `timeout_s` for a first byte."""
        ...

    def write(self, data: bytes) -> None:
        """Send bytes."""

    def sleep(self, duration_s: float) -> None:
        """Wait by the link's clock while its port is unplugged; only for links that `reopen`."""

    def reopen(self) -> None:
        """Reopen the port after a PortLostError; only for links that raise it.

        Raises
        ------
        RefusedError
            If another device has its name, and no other port has the board.
        SpotsError
            If it is not there, or cannot be opened.
        """

    def close_port(self) -> None:
        """Close the port until `reopen`; only for links that have it."""

    def close(self) -> None:
        """Close the port."""


class LinkWrapper:
    """Delegates to another link; the base class of wrappers.

    Parameters
    ----------
    link : Link
    """

    def __init__(self, link: Link):
        self._link = link

    @property
    def name(self) -> str:
        return self._link.name

    def now_s(self) -> float:
        return self._link.now_s()

    def read(self, timeout_s: float) -> bytes:
        return self._link.read(timeout_s)

    def write(self, data: bytes) -> None:
        self._link.write(data)

    def sleep(self, duration_s: float) -> None:
        self._link.sleep(duration_s)

    def reopen(self) -> None:
        self._link.reopen()

    def close_port(self) -> None:
        self._link.close_port()

    def close(self) -> None:
        self._link.close()


class Tap(LinkWrapper):
    """Shows what is read from another link.

    Parameters
    ----------
    link : Link
    look : callable
        ``look(data, now_s)``: what a read returned, and when.
    """

    def __init__(self, link: Link, look: Callable[[bytes, float], None]):
        super().__init__(link)
        self._look = look

    def read(self, timeout_s: float) -> bytes:
        data = self._link.read(timeout_s)
        self._look(data, self.now_s())
        return data


class SerialLink:
    """A port opened by pyserial, for one program at a time.

    Parameters
    ----------
    port : str
        Such as ``/dev/ttyACM0``, or a URL of pyserial's such as ``socket://HOST:PORT``.

    Raises
    ------
    SpotsError
        If there is no such port, it is busy, or it may not be opened.
    """

    # Of a read on Windows, where another one sets up the whole port again, which takes
    # milliseconds and may lose what was just written.
    _STEP_S = 0.005

    def __init__(self, port: str):
        self.name = port
        self._serial: Any = None
        self._is_url = "://" in port
        self._turn = 0
        # A port of the same number is that of the same device, whatever the port is called.
        self._is_usb = port in (numbers := _usb_numbers())
        self._number = numbers.get(port)
        self._open()

    def reopen(self) -> None:
        """Open the port again, under whichever name its device has now."""
        self.close_port()
        names = self._names()
        self._turn += 1  # of several ports of the device, the next one
        self.name = names[self._turn % len(names)]
        self._open()

    def close_port(self) -> None:
        self.close()

    def _names(self) -> list[str]:
        if not self._is_usb:
            return [self.name]
        numbers = _usb_numbers()
        names = [name for name, number in numbers.items() if number == self._number]
        if names:
            return names
        if self.name in numbers:
            raise RefusedError(f"another device is on {self.name} now")
        raise SpotsError(no_port(self.name))

    def _open(self) -> None:
        try:
            # The speed means nothing to USB; a number keeps UART bridges happy.
            self._serial = serial.serial_for_url(
                self.name,
                115_200,
                timeout=self._STEP_S,
                exclusive=True,
                write_timeout=WRITE_TIMEOUT_S,
            )
            self._serial.reset_input_buffer()
        except (*_FAILURES, ValueError) as error:
            self.close()
            raise SpotsError(_why_not(self.name, error)) from None

    def now_s(self) -> float:
        return time.monotonic()

    def sleep(self, duration_s: float) -> None:
        time.sleep(duration_s)

    def read(self, timeout_s: float) -> bytes:
        """Raises PortLostError if the port went away, SpotsError if it was closed."""
        if not self._serial.is_open:
            raise SpotsError(f"the port {self.name} was closed")
        end_s = self.now_s() + timeout_s
        try:
            if self._is_url:
                return self._read_url(timeout_s)
            if sys.platform != "win32":
                self._serial.timeout = timeout_s
            while True:
                data = self._serial.read(max(1, self._serial.in_waiting))
                if data or self.now_s() >= end_s:
                    return data
        except _FAILURES:
            raise PortLostError(f"the board on {self.name} was disconnected") from None

    def _read_url(self, timeout_s: float) -> bytes:
        # A socket never reports more than one byte waiting.
        self._serial.timeout = timeout_s
        data = self._serial.read(1)
        self._serial.timeout = 0
        return data and data + self._serial.read(_CHUNK)

    def write(self, data: bytes) -> None:
        """Raises PortLostError if the port went away, SpotsError if it takes nothing."""
        try:
            self._serial.write(data)
        except serial.SerialTimeoutException:
            raise SpotsError(takes_nothing(self.name)) from None
        except _FAILURES:
            raise PortLostError(f"the board on {self.name} was disconnected") from None

    def close(self) -> None:
        if self._serial is not None:
            self._serial.close()


def usb_ports() -> list[Any]:
    """Return pyserial's `ListPortInfo` of the serial ports that are USB devices."""
    ports: list[Any] = list(list_ports.comports())
    return sorted(port for port in ports if port.vid is not None)


def _usb_numbers() -> dict[str, str | None]:
    return {port.device: port.serial_number for port in usb_ports()}


def usb_boards() -> list[list[str]]:
    """Return the serial ports of each USB device; that with a prompt first, for frames last."""
    boards: dict[str, list[str]] = {}
    for port in usb_ports():
        boards.setdefault(port.serial_number or port.device, []).append(port.device)
    return list(boards.values())


def _why_not(port: str, error: Exception) -> str:
    number = getattr(error, "errno", None)
    text = str(error).lower()
    if number == errno.ENOENT or "no such file" in text or "cannot find" in text:
        return no_port(port)
    if number == errno.EISDIR:
        return f"{port} is a directory, not a serial port: 'spots ports' lists the ports"
    # Windows denies access to a port that another program has open.
    denied = number == errno.EACCES or "permission" in text or "access is denied" in text
    busy = number in (errno.EBUSY, errno.EAGAIN) or "exclusively lock" in text
    if busy or (denied and sys.platform == "win32"):
        return f"{port} is busy: close the other program that uses it"
    if denied:
        return f"{port} may not be opened: add yourself to its group (ls -l {port}), log in again"
    return f"{port} cannot be opened as a serial port: {error}"
