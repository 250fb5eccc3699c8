"""Reads and writes UF2 files for the RP2040 and RP2350.

Sources: Microsoft, "USB Flashing Format (UF2)" (https://github.com/microsoft/uf2); Raspberry Pi,
RP2040 datasheet, section 2.8.4.2, and RP2350 datasheet, section 5.5 (the boot ROM accepts payloads
of 256 bytes only; each family has its own numbers of blocks).
"""

import struct
from typing import NamedTuple

from ..errors import FileError, SpotsError

PAYLOAD = 256  # bytes of flash in a block
SECTOR = 4096  # bytes of flash that are erased at once
_BLOCK = 512
_HEAD = struct.Struct("<8I")
_MAGIC = 0x0A324655, 0x9E5D5157
_END = struct.pack("<I", 0x0AB16F30)
_HAS_FAMILY = 0x2000
_NOT_FLASH = 0x0001

RP2040 = 0xE48BFF56
RP2350_ARM = 0xE48BFF59
# A file for the RP2350 may begin with one block of this family, to which the boot ROM must not
# apply a partition table (erratum RP2350-E10). Its numbers count for themselves.
ABSOLUTE = 0xE48BFF57

FLASH = 0x10000000  # first address of the flash
FLASH_END = FLASH + (16 << 20)


class Uf2(NamedTuple):
    """Content of a UF2 file.

    `family` is a kind of chip, such as `RP2040`. `flash` has 256 bytes by their address, in the
    order of the file. `first` is the absolute block with which the file begins, 512 bytes as they
    are; empty without one.
    """

    family: int
    flash: dict[int, bytes]
    first: bytes


def read(data: bytes, name: str) -> Uf2:
    """Read a UF2 file, and check every block.

    FileError if a block is damaged, missing, written twice or of another kind than its neighbours.
    """

    def refuse(number: int, why: str) -> SpotsError:
        return FileError(f"{name}: block {number} of the UF2 file {why}: download it again", name)

    if not data or len(data) % _BLOCK:
        raise FileError(f"{name} is not a whole UF2 file: download MicroPython's UF2 again", name)
    first = data[:_BLOCK] if _HEAD.unpack_from(data)[7] == ABSOLUTE else b""
    blocks = len(data) // _BLOCK - bool(first)
    family, flash, following = None, {}, FLASH
    for number in range(bool(first), len(data) // _BLOCK):
        block = data[number * _BLOCK : (number + 1) * _BLOCK]
        *magic, flags, address, size, at, total, kind = _HEAD.unpack_from(block)
        if tuple(magic) != _MAGIC or block[-4:] != _END:
            raise refuse(number, "has no magic number")
        if not flags & _HAS_FAMILY or flags & _NOT_FLASH:
            raise refuse(number, "is not for the flash of a known chip")
        family = kind if family is None else family
        if kind != family:
            raise refuse(number, f"has family {kind:08x}, the others have {family:08x}")
        if size != PAYLOAD or address % PAYLOAD or not FLASH <= address < FLASH_END:
            raise refuse(number, f"has {size} bytes for address {address:08x}")
        if (at, total) != (len(flash), blocks):
            raise refuse(number, f"has number {at} of {total}")
        # Addresses rise, and what follows a gap begins a sector of its own.
        if flash and address != following and (address < following or address % SECTOR):
            raise refuse(number, f"has address {address:08x} after {following:08x}")
        following = address + PAYLOAD
        flash[address] = block[_HEAD.size : _HEAD.size + PAYLOAD]
    if first and (first[:8] != _HEAD.pack(*_MAGIC, *[0] * 6)[:8] or first[-4:] != _END):
        raise refuse(0, "has no magic number")
    if family is None:
        raise FileError(
            f"{name} has no block for the flash: download MicroPython's UF2 again", name
        )
    return Uf2(family, flash, first)


def write(content: Uf2) -> bytes:
    """Return a UF2 file: the absolute block first, then all others, numbered together."""
    total = len(content.flash)
    blocks = (
        _HEAD.pack(*_MAGIC, _HAS_FAMILY, address, PAYLOAD, at, total, content.family)
        + payload.ljust(_BLOCK - _HEAD.size - len(_END), b"\0")
        + _END
        for at, (address, payload) in enumerate(content.flash.items())
    )
    return content.first + b"".join(blocks)
