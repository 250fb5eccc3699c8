"""A serial port as a link: read, write, close, and the time by which its bytes arrive."""

from __future__ import annotations

import errno
import time
from typing import Protocol

import serial
from serial.tools import list_ports

from .errors import SpotsError


class Link(Protocol):
    """What a board is talked to over. Owns no protocol logic."""

    name: str

    def now_s(self) -> float:
        """Return the host's time by this link's clock."""

    def read(self, timeout_s: float) -> bytes:
        """Return what has arrived, waiting up to `timeout_s` for a first byte."""

    def write(self, data: bytes) -> None:
        """Send bytes."""

    def close(self) -> None:
        """Let the port go."""


class SerialLink:
    """A port opened by pyserial, for one program at a time.

    Parameters
    ----------
    port : str
        Such as ``/dev/ttyACM0``.

    Raises
    ------
    SpotsError
        If there is no such port, it is busy, or it may not be opened.
    """

    _WRITE_TIMEOUT_S = 2.0

    def __init__(self, port: str):
        self.name = port
        try:
            # The speed means nothing to USB; a number keeps UART bridges happy.
            self._serial = serial.Serial(
                port, 115_200, exclusive=True, write_timeout=self._WRITE_TIMEOUT_S
            )
        except (serial.SerialException, ValueError) as error:
            raise SpotsError(_why_not(port, error)) from None
        self._serial.reset_input_buffer()

    def now_s(self) -> float:
        return time.monotonic()

    def read(self, timeout_s: float) -> bytes:
        """Raises SpotsError if the port went away."""
        try:
            self._serial.timeout = timeout_s
            return self._serial.read(max(1, self._serial.in_waiting))
        except (serial.SerialException, OSError):
            raise SpotsError(f"the board on {self.name} was disconnected") from None

    def write(self, data: bytes) -> None:
        """Raises SpotsError if the port went away or takes nothing."""
        try:
            self._serial.write(data)
        except serial.SerialTimeoutException:
            raise SpotsError(f"{self.name} takes no data: replug the board") from None
        except (serial.SerialException, OSError):
            raise SpotsError(f"the board on {self.name} was disconnected") from None

    def close(self) -> None:
        self._serial.close()


def usb_ports() -> list:
    """Return pyserial's `ListPortInfo` of the serial ports that are USB devices."""
    return sorted(port for port in list_ports.comports() if port.vid is not None)


def _why_not(port: str, error: Exception) -> str:
    number = getattr(error, "errno", None)
    text = str(error).lower()
    if number == errno.ENOENT or "no such file" in text or "cannot find" in text:
        return f"there is no port {port}; 'spots ports' lists those that there are"
    if number in (errno.EBUSY, errno.EAGAIN) or "exclusively lock" in text:
        return f"{port} is busy: close the other program that uses it"
    if number == errno.EACCES or "permission" in text or "access is denied" in text:
        return f"{port} may not be opened: add yourself to its group (ls -l {port}), log in again"
    return f"{port} cannot be opened as a serial port: {error}"
