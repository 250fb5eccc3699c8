"""Where a board's files go, and the port on which it answers after its restart."""

from __future__ import annotations

import contextlib
from collections.abc import Callable, Iterator
from dataclasses import dataclass

from ..errors import SpotsError
from ..link.ports import offered
from ..link.serial_link import usb_boards, usb_ports
from .drive import Drive, drives
from .prompt import Prompt
from .staging import Device


@dataclass(frozen=True)
class Place:
    """A connection to a board.

    Attributes
    ----------
    name : str
        A serial port, or where a drive is mounted.
    open : callable
        Opens its file system: a `deploy.prompt.Prompt` or a `deploy.drive.Drive`.
    ports : callable
        Returns the serial ports on which the board may answer.
    """

    name: str
    open: Callable[[], Prompt | Drive]
    ports: Callable[[], list[str]]


@contextlib.contextmanager
def place(device: Device, port: str | None) -> Iterator[Place]:
    """Find the one board; a port scheme may start one for the duration of the block.

    Parameters
    ----------
    device : staging.Device
        What is to go there.
    port : str, optional
        A serial port, or the folder of a CircuitPython drive; found if not given.

    Yields
    ------
    Place
        The board's file system and ports.

    Raises
    ------
    SpotsError
        If none or more than one is found.
    """
    started = offered(port or device.port, "flash_place")
    if started is not None:
        with started(device) as there:
            yield there
    elif device.runtime == "circuitpython":
        yield _on_drive(port or _the_one(drives(), "CIRCUITPY drive"))
    else:
        yield _on_port(port or the_board()[0])


def the_board() -> list[str]:
    """Return the ports of the only USB board.

    Raises
    ------
    SpotsError
        If none or more than one is found.
    """
    boards = {ports[0]: ports for ports in usb_boards()}
    return boards[_the_one(list(boards), "board")]


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
        ports = usb_ports() if uid else []
        return [usb.device for usb in ports if (usb.serial_number or "").lower() == uid]

    def opened() -> Drive:
        return Drive(folder, next(iter(consoles_first()), None))

    return Place(folder, opened, lambda: consoles_first()[::-1])


def _the_one(names: list[str], what: str) -> str:
    if not names:
        raise SpotsError(f"no {what} found: plug one in with a cable that carries data")
    if len(names) > 1:
        raise SpotsError(f"more than one {what} found, name one with --port: {', '.join(names)}")
    return names[0]
