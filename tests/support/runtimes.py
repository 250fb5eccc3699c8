"""Runtimes that are none, in the form in which one downloads them: for tests of images.

Written from the formats' own documents, apart from the code under test: vectors and the binary info
of the Pico SDK, UF2 blocks, and the partition table of ESP-IDF.
"""

import struct

FLASH = 0x10000000
RP2040, RP2350 = 0xE48BFF56, 0xE48BFF59
INFO_AT = 0x1D4  # where a build of MicroPython 1.28 for the Pico has its header

# Offset and size of the file system, and family, of MicroPython's builds.
PICO = (0xA0000, 1408 << 10, RP2040)
PICO2 = (0x100000, 3072 << 10, RP2350)


def program(drive_at, size, name=b"MicroPython", version=b"v1.28.0", drives=1, romfs=True):
    """Return a program of 64 KiB that has vectors, binary info and nothing else."""
    code = bytearray(range(256)) * 256
    struct.pack_into("<II", code, 0x100, 0x20042000, FLASH + 0x1F7)
    at, table = 0x8000, []

    def put(data):
        nonlocal at
        code[at : at + len(data)] = data
        at += len(data) + -len(data) % 4
        return FLASH + at - len(data) - -len(data) % 4

    def text(raw):
        return put(raw + b"\0")

    table.append(put(struct.pack("<HHII", 6, 0x5052, 0x02031C86, text(name))))
    table.append(put(struct.pack("<HHII", 6, 0x5052, 0x11A9BC3A, text(version))))
    table.append(put(struct.pack("<HHIi", 5, 0x5052, 0x68F465DE, FLASH + len(code))))
    if romfs:
        romfs = struct.pack("<HHIIIIH", 7, 0x504D, text(b"ROMFS"), FLASH + 0x90000, 0x10000, 0, 1)
        table.append(put(romfs))
    for _ in range(drives):
        fields = 7, 0x504D, text(b"MicroPython"), FLASH + drive_at, size, 0, 3
        table.append(put(struct.pack("<HHIIIIH", *fields)))
    start = put(struct.pack(f"<{len(table)}I", *table))
    struct.pack_into("<5I", code, INFO_AT, 0x7188EBF2, start, start + 4 * len(table), 0, 0xE71AA390)
    return bytes(code)


def block(address, payload, number, total, family, flags=0x2000):
    """Return a block of a UF2 file."""
    head = struct.pack(
        "<8I", 0x0A324655, 0x9E5D5157, flags, address, len(payload), number, total, family
    )
    return head + payload.ljust(476, b"\0") + struct.pack("<I", 0x0AB16F30)


def uf2(code, family, absolute=False):
    """Return a program as a UF2 file, on request with the absolute block of an RP2350."""
    parts = [code[at : at + 256] for at in range(0, len(code), 256)]
    first = block(0x10FFFF00, b"\xef" * 256, 0, 2, 0xE48BFF57) if absolute else b""
    return first + b"".join(
        block(FLASH + 256 * number, part, number, len(parts), family)
        for number, part in enumerate(parts)
    )


def micropython(drive_at, size, family, **more):
    """Return a UF2 file such as MicroPython's for a Pico or, with its family, a Pico 2."""
    return uf2(program(drive_at, size, **more), family, absolute=family == RP2350)


def esp32(offset=0x200000, size=0x600000, label=b"vfs"):
    """Return a .bin file such as MicroPython's for an ESP32-S3: boot loader, table, program."""
    rows = [(1, 2, 0x9000, 0x6000, b"nvs"), (0, 0, 0x10000, 0x1F0000, b"factory")]
    rows.append((1, 0x81, offset, size, label))
    table = b"".join(struct.pack("<2sBBII16sI", b"\xaa\x50", *row, 0) for row in rows)
    code = b"\xe9" + b"MicroPython v1.28.0" + bytes(0x4000)
    return code.ljust(0x8000, b"\xff") + table.ljust(0x8000, b"\xff") + code


def circuitpython(board_id=b"adafruit_qtpy_rp2040"):
    """Return a UF2 file such as CircuitPython's for an RP2040."""
    code = bytearray(bytes(range(256)) * 256)
    text = b"Board ID:" + board_id + b"\r\n"
    code[0x4000 : 0x4000 + len(text)] = text
    return uf2(bytes(code), RP2040)
