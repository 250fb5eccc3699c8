"""Installs runtime and firmware on a board whose boot loader is mounted as a drive.

A board of the RP2040 or RP2350 does this if it is plugged in while BOOTSEL is held. This needs no
permission for serial ports.
"""

import os
from contextlib import suppress
from pathlib import Path

from rich.console import Console
from rich.progress import track

from ..errors import PortError, SettingError, printable
from ..link.serial_link import usb_boards
from . import uf2
from .boot_drive import ABOUT, BootDrive, boot_drives, drive_at
from .confirm import confirm
from .image import compose
from .place import restarted
from .runtime_files import form_of
from .staging import device_of

_CHUNK = 64 << 10


def install(
    board: str,
    runtime: str,
    folder: str | None = None,
    strips: int = 1,
    layout: list[str] = (),
    led: str | None = None,
    yes: bool = False,
) -> None:
    """Copy an image to a board in its boot loader, and wait until the firmware answers.

    `runtime`, `layout` and `led` are those of `image.image`. Without `folder`, the board's drive is
    found. `yes` skips the confirmation. SpotsError if there is no such drive or more than one, or
    it belongs to another chip; if the runtime is not one for this board; if the user does not
    confirm; if the copy fails, or the firmware does not answer.
    """
    device = device_of(board, strips)
    if form_of(device).suffix != ".uf2":
        raise SettingError(
            f"the boot loader of {board} is not a drive: 'spots image' writes a file"
        )
    data = compose(device, Path(runtime), strips, layout, led)
    drive = _the_drive(folder)
    if uf2.read(data, runtime).family != drive.family:
        raise SettingError(
            f"the drive {drive.folder} belongs to another chip than {board} has: name the board "
            "that is plugged in"
        )
    if not yes:
        question = f"erase everything on the board with the drive {drive.folder}, also its settings"
        confirm("flash --runtime", f"{question} and calibration?", "nothing was copied")
    before = {port for ports in usb_boards() for port in ports}
    _copy(data, Path(drive.folder))
    done = "the image is on the board, but "
    try:
        there = restarted(lambda: _new_ports(before), done)
    except PortError:
        if drive_at(drive.folder) is None:
            raise
        raise PortError(
            f"the boot loader has not started the image, because its drive {drive.folder} is still "
            "there: unplug the board, hold BOOTSEL while you plug it in, and run the command again"
        ) from None
    with there:
        print("{board}, firmware {firmware}, {runtime}".format(**there.info), printable(there.port))


def _the_drive(folder: str | None) -> BootDrive:
    if folder is not None:
        drive = drive_at(folder)
        if drive is None:
            raise SettingError(
                f"{folder} is not the drive of a boot loader: name the folder that has {ABOUT}"
            )
        return drive
    drives = boot_drives()
    if not drives:
        raise PortError(
            "no drive of a boot loader is mounted: hold BOOTSEL while you plug the board in"
        )
    if len(drives) > 1:
        names = ", ".join(drive.folder for drive in drives)
        raise PortError(f"more than one drive of a boot loader: name one with --port: {names}")
    return drives[0]


def _copy(data: bytes, folder: Path) -> None:
    path = folder / "spots.uf2"
    left, steps, console = len(data), range(0, len(data), _CHUNK), Console(stderr=True)
    hidden = not console.is_terminal
    try:
        # Unbuffered: the board restarts with the last block, so closing the file may fail.
        with open(path, "wb", buffering=0) as file:
            for at in track(steps, "copying", console=console, disable=hidden, transient=True):
                view = memoryview(data)[at : at + _CHUNK]
                while view:
                    written = file.write(view)
                    view, left = view[written:], left - written
                with suppress(OSError if left == 0 else ()):
                    os.fsync(file.fileno())
    except OSError as error:
        if left:
            raise PortError(
                f"the copy to {folder} stopped ({error.strerror}): hold BOOTSEL while you plug the "
                "board in, and run the command again"
            ) from None


def _new_ports(before: set[str]) -> list[str]:
    return [ports[-1] for ports in usb_boards() if not before.intersection(ports)]
