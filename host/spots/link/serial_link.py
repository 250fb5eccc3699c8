"""`SerialLink`: the link to a board over a serial port. USB devices and their port names."""

import errno
import os
import re
import sys
from collections.abc import Callable
from contextlib import suppress
from typing import Any

import serial
from serial.tools import list_ports

from ..common.kinds import kinds_of
from ..errors import ClosedError, PortError, PortLostError, RefusedError
from .link import Link
from .ports import no_port

try:
    import termios
except ImportError:  # Windows has no termios
    termios = None
# Errors of a port that is disconnected or cannot be opened.
_FAILURES = (serial.SerialException, OSError, *([termios.error] if termios else []))

# The operating system's error at the end of pyserial's text; on Windows, it is only there.
_WINDOWS = re.compile(r"Error\((\d+), ")
WRITE_TIMEOUT_S = 2.0
_BEGINNING = 1 << 16  # bytes of a file that show its kind
_CHUNK = 4096  # most bytes of one read from a socket


def takes_nothing(port: str) -> str:
    """Return the error message for a port that accepts no bytes within `WRITE_TIMEOUT_S`."""
    return f"the board on {port} accepts no data: replug the board"


class SerialLink(Link):
    """Link to a board over a serial port, which no other program can open meanwhile.

    The port may be a URL of pyserial such as ``socket://HOST:PORT``. PortError if it does not
    exist, is busy, or access is denied.
    """

    # Timeout of a read on Windows. The timeout never changes, because a change sets up the port
    # again, which takes milliseconds and may lose bytes that were just written.
    _STEP_S = 0.005

    def __init__(self, port: str):
        self.name = port
        self._serial: Any = None
        self._is_url = "://" in port
        self._turn = 0
        self._was_open = self._connected = False
        self._device = usb_device(port)
        self._open()

    def reopen(self) -> None:
        """Open the port again, under the name that its device has now."""
        self.close_port()
        names = self._names()
        self._turn += 1  # a device may have several ports: try the next one
        self.name = names[self._turn % len(names)]
        self._open()

    def close_port(self) -> None:
        self.close()

    def _names(self) -> list[str]:
        if self._device is None:
            return [self.name]
        names = self._device.ports()
        if names:
            return names
        if others := self._device.others():
            raise RefusedError(
                f"the device on {others[0]} may be another board, because boards have the same USB "
                f"serial number: plug the board of {self.name} into its previous USB socket"
            )
        if any(port.device == self.name for port in usb_ports()):
            raise RefusedError(f"another device is on {self.name}: plug the board in again")
        raise PortLostError(_lost(self.name))

    def _open(self) -> None:
        try:
            # USB ignores the speed; UART bridges need one.
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
            if self._was_open and _errno(error) == errno.ENOENT:
                raise PortLostError(_lost(self.name)) from None
            raise PortError(_why_not(self.name, error)) from None
        self._was_open = self._connected = True

    def read(self, timeout_s: float) -> bytes:
        """Return the bytes that have arrived; wait up to `timeout_s` seconds for the first one.

        Raises PortLostError if the port disappeared, SpotsError if the program has closed it.
        """
        if not self._serial.is_open:
            raise ClosedError(f"the port {self.name} is closed: open the board again")
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
            raise self._lost() from None

    def _read_url(self, timeout_s: float) -> bytes:
        # For a socket, pyserial never reports more than one waiting byte.
        self._serial.timeout = timeout_s
        data = self._serial.read(1)
        self._serial.timeout = 0
        return data and data + self._serial.read(_CHUNK)

    def write(self, data: bytes) -> None:
        """Send bytes.

        Raises PortLostError if the port disappeared, SpotsError if the port accepts no data.
        """
        try:
            self._serial.write(data)
        except serial.SerialTimeoutException:
            raise PortError(takes_nothing(self.name)) from None
        except _FAILURES:
            raise self._lost() from None

    def close(self) -> None:
        if self._serial is not None:
            self._serial.close()

    def _lost(self) -> PortLostError:
        if self._device is not None and self._connected:
            self._device.lost(self.name)
        self._connected = False
        return PortLostError(_lost(self.name))


def _lost(port: str) -> str:
    return f"the board on {port} was disconnected: plug the board in again"


def usb_ports() -> list[Any]:
    """Return a `ListPortInfo` of pyserial for each serial port of a USB device."""
    ports: list[Any] = list(list_ports.comports())
    return sorted(port for port in ports if port.vid is not None)


def usb_boards(wanted: Callable[[str], bool] = lambda number: True) -> list[list[str]]:
    """Return the port names of each USB device whose serial number is `wanted`.

    A CircuitPython board may have two ports. The first one is the prompt of Python (REPL); the last
    one sends the frames.
    """
    boards: dict[tuple[str, str], list[str]] = {}
    for port in usb_ports():
        if not wanted(_number(port)):
            continue
        which = _number(port), _socket(port)
        boards.setdefault(which if any(which) else (port.device, ""), []).append(port.device)
    return list(boards.values())


class UsbDevice:
    """Identity of a USB device, whose ports may get other names when it is plugged in again.

    A serial number that only this device has identifies the device in every USB socket. Some boards
    have the same serial number, or none: then the device is the one in the same socket.
    """

    def __init__(self, port: Any):
        self._number, self._socket = _number(port), _socket(port)
        self._sockets = {port.device: self._socket}  # where `ports` found each port
        self._is_unique = bool(self._number or not self._socket)
        self.lost(port.device)

    def lost(self, name: str) -> None:
        """Record that the device has just been unplugged from the port `name`.

        A device that has its serial number at this time, in another socket, is another device.
        """
        self._socket = self._sockets.get(name, self._socket)
        self._is_unique &= all(_socket(port) == self._socket for port in self._same())

    def ports(self) -> list[str]:
        """Return the present names of the device's ports; empty if it is not plugged in.

        If it cannot be known which one of several devices this is, return an empty list, too.
        """
        same = self._same()
        here = [port for port in same if _socket(port) == self._socket]
        if here or not self._is_unique or len({_socket(port) for port in same}) > 1:
            same = here
        self._sockets = {port.device: _socket(port) for port in same}
        return list(self._sockets)

    def others(self) -> list[str]:
        """Return the names of ports whose devices have the same serial number, but are others."""
        found = set(self.ports())
        return [port.device for port in self._same() if self._number and port.device not in found]

    def _same(self) -> list[Any]:
        return [port for port in usb_ports() if _number(port) == self._number]


def usb_device(port: str) -> UsbDevice | None:
    """Return the device of a port; None if the port is not one of a USB device."""
    return next((UsbDevice(usb) for usb in usb_ports() if usb.device == port), None)


def _number(port: Any) -> str:
    return port.serial_number or ""


def _socket(port: Any) -> str:
    """Return the place of a port's device in the tree of USB hubs; empty if unknown."""
    return (getattr(port, "location", None) or "").partition(":")[0]  # without the interface


def _errno(error: BaseException) -> int | None:
    """Return the number of the operating system's error behind an error of pyserial."""
    for one in (error, error.__context__):
        if termios and isinstance(one, termios.error):
            return one.args[0]
        if isinstance(number := getattr(one, "errno", None), int):
            return number
    found = _WINDOWS.search(str(error))
    return int(found[1]) if found else None


def _no_port(port: str, number: int | None) -> str:
    """Return what is at a path that cannot be opened as a port; empty if it may be a port."""
    if os.path.isdir(port):
        return "a folder"
    if os.path.isfile(port):
        with suppress(OSError), open(port, "rb") as file:
            return next(iter(kinds_of(file.read(_BEGINNING))), "a file")
        return "a file"
    return "another device" if number == errno.ENOTTY else ""


def _why_not(port: str, error: Exception) -> str:
    """Return the message for a port that cannot be opened: the reason and a remedy."""
    number = _errno(error)
    if number == errno.ENOENT:
        return no_port(port)
    if what := _no_port(port, number):
        known = "'spots ports' lists the ports"
        advice = f"give recording:{port}" if what == "a recording" else known
        return f"{port} is {what}, not a serial port: {advice}"
    # Windows denies access to a port that is open in another program.
    denied = number == errno.EACCES
    if number in (errno.EBUSY, errno.EAGAIN) or (denied and sys.platform == "win32"):
        return f"{port} is busy: close the other program that uses it"
    if not denied:
        return f"{port} cannot be opened as a serial port: {error}"
    group = f"no permission to open {port}: join the group in 'ls -l {port}' and log in again"
    vid = next((usb.vid for usb in usb_ports() if usb.device == port), None)
    if vid is None or not sys.platform.startswith("linux"):
        return group
    rule = f'SUBSYSTEM=="tty", ATTRS{{idVendor}}=="{vid:04x}", TAG+="uaccess"'
    return f"{group}; or put this line into /etc/udev/rules.d/60-spots.rules and replug: {rule}"
