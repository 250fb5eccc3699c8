"""Finds boards whose boot loader is mounted as a drive: of the RP2040 and the RP2350."""

import re
from contextlib import suppress
from pathlib import Path
from typing import NamedTuple

from ..common.bounded import read_bytes
from ..errors import SpotsError
from . import uf2
from .drive import removable

ABOUT = "INFO_UF2.TXT"
_ABOUT_BYTES = 4096
_BOARD_ID = re.compile(rb"Board-ID: *(\S+)")
# What the boot ROMs write (RP2040 datasheet, section 2.8.4.1; RP2350 datasheet, section 5.7).
_FAMILIES = {b"RPI-RP2": uf2.RP2040, b"RP2350": uf2.RP2350_ARM}


class BootDrive(NamedTuple):
    """A boot loader's drive: the folder where it is mounted, and the chip's family in UF2 files."""

    folder: str
    family: int


def boot_drives() -> list[BootDrive]:
    """Return the mounted drives of boot loaders; none if psutil is missing."""
    try:
        folders = removable(ABOUT)
    except SpotsError:
        return []
    return [drive for drive in map(drive_at, folders) if drive]


def drive_at(folder: str) -> BootDrive | None:
    """Return the drive that is mounted in a folder; None if it is not one of a boot loader."""
    with suppress(OSError, SpotsError):
        found = _BOARD_ID.search(read_bytes(Path(folder, ABOUT), _ABOUT_BYTES))
        if found and found[1] in _FAMILIES:
            return BootDrive(folder, _FAMILIES[found[1]])
    return None
