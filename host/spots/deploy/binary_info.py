"""Reads the facts that a program for the RP2040 or RP2350 contains about itself.

Source: Raspberry Pi, Pico SDK, headers ``pico/binary_info/defs.h`` and ``structure.h``: a header
near the start of the flash has the first and the last address of a table of pointers to entries.
"""

import struct
from typing import NamedTuple

_HEADER = struct.Struct("<5I")
_START, _END = 0x7188EBF2, 0xE71AA390
_SEARCHED = 0x400  # the header's words lie below, on both chips
_ENTRIES_MAX = 1000
_TEXT_MAX = 256
_ENTRY = struct.Struct("<HH")
_TEXT, _DRIVE = 6, 7  # types of entries: a text with a number; a block device
_NAME_ID, _VERSION_ID = 0x02031C86, 0x11A9BC3A


class Drive(NamedTuple):
    """A file system of a program: its name, first address and size in bytes."""

    name: str
    address: int
    size: int


class About(NamedTuple):
    """What a program contains about itself: such as ``MicroPython``, ``v1.28.0``, its file systems.

    Name and version are empty if unknown.
    """

    name: str
    version: str
    drives: list[Drive]


def about(flash: bytes, base: int) -> About:
    """Return the facts that a program contains about itself; `base` is the address of its start.

    ValueError if the program has no such facts, or they point outside the program.
    """

    def unpack(form: str | struct.Struct, address: int) -> tuple:
        form = form if isinstance(form, struct.Struct) else struct.Struct(form)
        if not base <= address <= base + len(flash) - form.size:
            raise ValueError(f"its binary info points to {address:08x}, outside the program")
        return form.unpack_from(flash, address - base)

    def text(address: int) -> str:
        unpack("<B", address)
        raw = flash[address - base :][:_TEXT_MAX].partition(b"\0")[0]
        return raw.decode("ascii", "replace")

    table = next(
        (
            fields[1:3]
            for at in range(0, min(_SEARCHED, len(flash) - _HEADER.size), 4)
            if (fields := _HEADER.unpack_from(flash, at))[0] == _START and fields[4] == _END
        ),
        None,
    )
    if table is None:
        raise ValueError("it has no binary info")
    if not 0 <= table[1] - table[0] <= 4 * _ENTRIES_MAX:
        raise ValueError("its binary info has no end")
    texts, drives = {}, []
    for at in range(*table, 4):
        (entry,) = unpack("<I", at)
        kind, _ = unpack(_ENTRY, entry)
        if kind == _TEXT:
            number, address = unpack("<II", entry + _ENTRY.size)
            if number in (_NAME_ID, _VERSION_ID):
                texts[number] = text(address)
        elif kind == _DRIVE:
            name, address, size = unpack("<III", entry + _ENTRY.size)
            drives.append(Drive(text(name), address, size))
    return About(texts.get(_NAME_ID, ""), texts.get(_VERSION_ID, ""), drives)
