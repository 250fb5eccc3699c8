"""Finds a board's file system, and the serial port on which the board answers after a restart."""

import contextlib
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass

from rich.console import Console

from ..common.cursor import cursor_shown
from ..errors import PortError, SpotsError
from ..link.board import Board
from ..link.connect import open as open_board
from ..link.ports import offered
from ..link.serial_link import usb_boards, usb_device
from .boot_drive import boot_drives
from .drive import Drive, drives
from .prompt import Prompt
from .staging import Device

_RETURN_S = 20.0  # longest time for the restart of a board
_POLL_S = 0.2  # pause between two attempts to open the restarted board


@dataclass(frozen=True)
class Place:
    """How to reach a board: its file system, and its serial ports after a restart.

    `name` is that of the serial port, or the folder where the drive is mounted. ``open()`` opens
    the file system. ``ports()`` returns the serial ports on which the board may answer.
    """

    name: str
    open: Callable[[], Prompt | Drive]
    ports: Callable[[], list[str]]


@contextlib.contextmanager
def place(device: Device, port: str | None) -> Iterator[Place]:
    """Find a board to flash or erase; or start a simulated board, which runs during the block.

    `port` may be the folder of a CircuitPython drive. PortError if `port` is not given, and no
    board or more than one board is found; or if the board needs CircuitPython, and `port` is not
    its drive. A kind of port with the ability ``flash_place(device)``, see `link.ports`, gives the
    board to flash itself.
    """
    started = offered(port or device.port, "flash_place")
    if started is not None:
        with started(device) as there:
            yield there
    elif device.runtime == "circuitpython":
        yield _on_drive(port or _the_one(drives(), "CIRCUITPY drive"))
    else:
        yield on_port(port or the_board()[0])


def the_board() -> list[str]:
    """Return the serial ports of the only USB board; PortError if there is none, or several."""
    boards = {ports[0]: ports for ports in usb_boards()}
    if not boards and (drives := boot_drives()):
        raise PortError(
            f"the board with the drive {drives[0].folder} is in its boot loader: download its "
            "MicroPython or CircuitPython, and add --runtime FILE.uf2"
        )
    return boards[_the_one(list(boards), "board")]


def on_port(port: str) -> Place:
    """Return the place of a board with a prompt on the serial port `port`."""
    device = usb_device(port)

    def ports_now() -> list[str]:
        # After a reset the same device may have another name.
        return [port] if device is None else device.ports()

    return Place(port, lambda: Prompt(port), ports_now)


def restarted(
    ports: Callable[[], list[str]], done: str = "", why_not: Callable[[Board], str] = lambda _: ""
) -> Board:
    """Wait until the firmware of a restarted board answers, and open the board.

    ``ports()`` returns the serial ports on which the board may answer. ``why_not(board)`` returns a
    reason to wait for another answer, or an empty text. PortError if the firmware does not answer
    within 20 s; it begins with what has been `done`.
    """
    deadline_s = time.monotonic() + _RETURN_S
    reason = "the board is not on USB"
    console, waits = Console(stderr=True), f"waiting up to {_RETURN_S:g} s for the board to restart"
    with cursor_shown(console), console.status(waits):
        while time.monotonic() < deadline_s:
            time.sleep(_POLL_S)
            for port in ports():
                try:
                    board = open_board(port)
                except SpotsError as error:
                    reason = str(error)
                    continue
                reason = why_not(board)
                if not reason:
                    return board
                board.close()
    raise PortError(
        f"{done}the firmware does not answer after the restart ({reason}): replug the board"
    )


def _on_drive(folder: str) -> Place:
    with Drive(folder) as drive:
        uid = (drive.facts["uid"] or "").lower()

    def ports_now() -> list[str]:  # the console first, then the port of the frames
        devices = [] if not uid else usb_boards(lambda number: number.lower() == uid)
        if len(devices) > 1:
            raise PortError(
                f"two USB devices have the serial number of the board with the drive {folder}: "
                "unplug the other one"
            )
        return devices[0] if devices else []

    ports_now()  # before anything is copied
    return Place(folder, lambda: Drive(folder, *ports_now()[:1]), lambda: ports_now()[::-1])


def _the_one(names: list[str], what: str) -> str:
    if not names:
        raise PortError(f"no {what} found: plug one in with a USB cable that carries data")
    if len(names) > 1:
        raise PortError(f"more than one {what} found: name one with --port: {', '.join(names)}")
    return names[0]
