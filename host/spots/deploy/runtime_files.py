"""Reads a runtime as one downloads it, and adds a file system at the place that it uses.

MicroPython for the RP2040 and RP2350 names this place in its binary info, MicroPython for the
ESP32-S3 in its partition table. CircuitPython does not name it: folder2uf2 has a table.
"""

import io
import os
import re
import struct
from collections.abc import Callable
from contextlib import redirect_stdout
from pathlib import Path
from typing import NamedTuple

from ..errors import FileError, SettingError, missing
from . import binary_info, uf2
from .build import files_of
from .flash import OLDEST
from .littlefs_image import file_system
from .staging import Device

_EMPTY = b"\xff"
_FAMILIES = {"armv6m": uf2.RP2040, "armv7emsp": uf2.RP2350_ARM}
# What MicroPython writes at once to flash (ports/rp2/modules/_boot.py; extmod/vfs_lfs.c, default).
_PICO_PROGRAM, _ESP32_PROGRAM = 256, 32


class Form(NamedTuple):
    """What an image for a kind of board is made from.

    `suffix` and `heads` (first bytes) are those of the runtime's file and of the image; `source`
    names the runtime's file in messages. ``compose(device, data, name, build)`` checks the runtime,
    calls ``build() -> Path``, which builds the firmware in a folder, and returns the image.
    """

    suffix: str
    heads: tuple[bytes, ...]
    source: str
    compose: Callable[[Device, bytes, str, Callable[[], Path]], bytes]


def form_of(device: Device) -> Form:
    """Return the form of a board's images; SettingError if there is none: a virtual board."""
    if device.board_id:
        source = f"CircuitPython's UF2 for {device.board_id}"
        return Form(".uf2", (b"UF2\n",), source, _circuitpython)
    if device.download is None:
        raise SettingError(
            f"there is no image for {device.name}: name a board that is not simulated, see 'spots "
            "boards'"
        )
    source = f"MicroPython from micropython.org/download/{device.download}"
    if device.march == "xtensawin":
        return Form(".bin", (b"\xe9",), source, _esp32)
    return Form(".uf2", (b"UF2\n",), source, _pico(_FAMILIES[device.march]))


def _pico(family: int) -> Callable:
    def compose(device: Device, data: bytes, name: str, build: Callable[[], Path]) -> bytes:
        runtime = _uf2_for(device, family, data, name)
        program = _program(runtime)
        try:
            drive = _drive_of(binary_info.about(program, uf2.FLASH), runtime.flash)
        except ValueError as error:
            raise FileError(
                f"{name} is not a MicroPython for {device.name} ({error}): download "
                f"{form_of(device).source}",
                name,
            ) from None
        disk = file_system(files_of(build()), drive.size, _PICO_PROGRAM)
        return uf2.write(runtime._replace(flash=runtime.flash | _blocks(drive.address, disk)))

    return compose


def _uf2_for(device: Device, family: int, data: bytes, name: str) -> uf2.Uf2:
    runtime = uf2.read(data, name)
    if runtime.family != family:
        raise FileError(
            f"{name} is for another chip (family {runtime.family:08x}) than {device.name} "
            f"({family:08x}): download {form_of(device).source}",
            name,
        )
    return runtime


def _program(runtime: uf2.Uf2) -> bytes:
    """Return the flash from its first address to the end of the runtime."""
    program = bytearray(_EMPTY * (max(runtime.flash) + uf2.PAYLOAD - uf2.FLASH))
    for address, payload in runtime.flash.items():
        at = address - uf2.FLASH
        program[at : at + uf2.PAYLOAD] = payload
    return bytes(program)


def _drive_of(about: binary_info.About, flash: dict[int, bytes]) -> binary_info.Drive:
    title, oldest = OLDEST["micropython"]
    version = re.match(r"v(\d+)\.(\d+)", about.version)
    if about.name != title or not version:
        raise ValueError(f"its name is {about.name or 'unknown'} {about.version}".rstrip())
    if tuple(map(int, version.groups())) < oldest:
        raise ValueError(f"its version is {about.version}, older than {'.'.join(map(str, oldest))}")
    drives = [drive for drive in about.drives if drive.name == title]
    if len(drives) != 1:
        raise ValueError(f"it names {len(drives)} file systems, not one")
    (drive,) = drives
    _, address, size = drive
    if address % uf2.SECTOR or size % uf2.SECTOR or size < 4 * uf2.SECTOR:
        raise ValueError(f"its file system of {size} bytes at {address:08x} is not whole blocks")
    if not uf2.FLASH < address <= uf2.FLASH_END - size:
        raise ValueError(f"its file system at {address:08x} lies outside the flash")
    if any(address <= at < address + size for at in flash):
        raise ValueError(f"its file system at {address:08x} lies over its program")
    return drive


def _blocks(address: int, data: bytes) -> dict[int, bytes]:
    return {
        address + at: data[at : at + uf2.PAYLOAD].ljust(uf2.PAYLOAD, _EMPTY)
        for at in range(0, len(data), uf2.PAYLOAD)
    }


def _circuitpython(device: Device, data: bytes, name: str, build: Callable[[], Path]) -> bytes:
    try:
        import folder2uf2
    except ImportError:
        raise missing("an image for CircuitPython needs", "folder2uf2", "flash") from None
    family, offset, total = folder2uf2.BOARDS[device.board_id]
    runtime = _uf2_for(device, family, data, name)
    if f"Board ID:{device.board_id}".encode() not in _program(runtime):
        raise FileError(f"{name} is not {form_of(device).source}: download it", name)
    if max(runtime.flash) >= uf2.FLASH + offset:
        raise FileError(
            f"{name} is larger than the place for CircuitPython on {device.name}: download a "
            "stable version",
            name,
        )
    built = build()
    for path in [built, *built.rglob("*")]:
        os.utime(path, (_DATE_S, _DATE_S))
    disk = folder2uf2.FatBuilder(
        folder2uf2.Geometry((total - offset) // folder2uf2.SECTOR),
        volume_id=_DATE_S,
        build_ts=_DATE_S,
    )
    with redirect_stdout(io.StringIO()):
        disk.layout(folder2uf2.build_tree(str(built), build_ts=_DATE_S))
    blocks = _blocks(uf2.FLASH + offset, bytes(disk.image))
    return uf2.write(runtime._replace(flash=runtime.flash | blocks))


_DATE_S = 1735732800  # of the files on a CIRCUITPY drive: the same build gives the same image


# Partition table of Espressif's ESP-IDF, Programming Guide, "Partition Tables".
_TABLE, _TABLE_BYTES, _ROW = 0x8000, 0xC00, struct.Struct("<2sBBII16sI")
_ROW_MAGIC = b"\xaa\x50"


def _esp32(device: Device, data: bytes, name: str, build: Callable[[], Path]) -> bytes:
    regions = [
        (address, size)
        for magic, _, _, address, size, label, _ in _ROW.iter_unpack(
            data[_TABLE : _TABLE + _TABLE_BYTES].ljust(_TABLE_BYTES, _EMPTY)
        )
        if magic == _ROW_MAGIC and label.rstrip(b"\0") == b"vfs"
    ]
    if len(regions) != 1 or b"MicroPython" not in data:
        raise FileError(f"{name} is not {form_of(device).source}: download it", name)
    ((address, size),) = regions
    if (
        address % uf2.SECTOR
        or size % uf2.SECTOR
        or not 4 * uf2.SECTOR <= size <= 16 << 20
        or (address < len(data.rstrip(_EMPTY)))
    ):
        raise FileError(
            f"{name} has its file system at {address:08x}, inside its program: download "
            f"{form_of(device).source} again",
            name,
        )
    return data.rstrip(_EMPTY).ljust(address, _EMPTY) + file_system(
        files_of(build()), size, _ESP32_PROGRAM
    )
