"""Where a board's files go, and where the board is heard when it has started anew."""

from __future__ import annotations

import contextlib
import tempfile
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path

from ..errors import SpotsError
from ..link.connect import VIRTUAL, start_simulator
from ..link.serial_link import usb_boards, usb_ports
from .drive import Drive, drives
from .prompt import Prompt
from .staging import Device

_START_S = 10.0
_POLL_S = 0.02


@dataclass(frozen=True)
class Place:
    """A way to a board.

    Attributes
    ----------
    name : str
        A serial port, or where a drive is mounted.
    open : callable
        Opens its file system: a `prompt.Prompt` or a `drive.Drive`.
    ports : callable
        Returns the serial ports on which the board may answer now.
    """

    name: str
    open: Callable[[], Prompt | Drive]
    ports: Callable[[], list[str]]


@contextlib.contextmanager
def place(device: Device, port: str | None) -> Iterator[Place]:
    """Find the one way to a board; a virtual board, with an empty file system, lives as long.

    Parameters
    ----------
    device : stage.Device
        What is to go there.
    port : str, optional
        A serial port, or the folder of a CircuitPython drive; the one that there is, if not given.

    Raises
    ------
    SpotsError
        If there is none, or more than one.
    """
    if device.name.startswith(VIRTUAL) and port in (None, VIRTUAL):
        with tempfile.TemporaryDirectory() as folder, virtual_board(Path(folder), device) as there:
            yield there
    elif device.runtime == "circuitpython":
        yield _on_drive(port or _the_one(drives(), "CIRCUITPY drive"))
    else:
        yield _on_port(port or the_board()[0])


def the_board() -> list[str]:
    """Return the ports of the one USB board that there is.

    Raises
    ------
    SpotsError
        If there is none, or more than one.
    """
    boards = {ports[0]: ports for ports in usb_boards()}
    return boards[_the_one(list(boards), "board")]


@contextlib.contextmanager
def virtual_board(folder: Path, device: Device) -> Iterator[Place]:
    """Start a virtual board on a file system folder as it is."""
    start, end = start_simulator("default", "demo", 0, str(folder), device.name)
    try:
        heard = lambda: [start["port"]]  # noqa: E731
        if device.runtime == "circuitpython":
            _await_drive(folder)
            yield Place(str(folder), lambda: Drive(str(folder), start["console"]), heard)
        else:
            yield Place(start["port"], lambda: Prompt(start["port"]), heard)
    finally:
        end()


def _on_port(port: str) -> Place:
    serial_number = next((usb.serial_number for usb in usb_ports() if usb.device == port), None)

    def heard() -> list[str]:
        """After a reset the same device may have another name."""
        same = [usb.device for usb in usb_ports() if usb.serial_number == serial_number]
        return same if serial_number and len(same) == 1 else [port]

    return Place(port, lambda: Prompt(port), heard)


def _on_drive(folder: str) -> Place:
    with Drive(folder) as drive:
        uid = (drive.facts["uid"] or "").lower()

    def consoles_first() -> list[str]:
        return [usb.device for usb in usb_ports() if (usb.serial_number or "").lower() == uid]

    def opened() -> Drive:
        return Drive(folder, next(iter(consoles_first()), None))

    return Place(folder, opened, lambda: consoles_first()[::-1])


def _the_one(names: list[str], what: str) -> str:
    if not names:
        raise SpotsError(f"no {what} found: plug one in with a cable that carries data")
    if len(names) > 1:
        raise SpotsError(f"more than one {what} found, name one with --port: {', '.join(names)}")
    return names[0]


def _await_drive(folder: Path) -> None:
    end_s = time.monotonic() + _START_S
    while True:
        try:
            Drive(str(folder)).close()
            return
        except SpotsError:
            if time.monotonic() > end_s:
                raise SpotsError("the virtual board does not start") from None
        time.sleep(_POLL_S)
