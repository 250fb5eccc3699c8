"""Decodes COBS and checks CRC-32 of many frames of one length in one call.

A *piece* is an encoded frame without its delimiter.

Each NumPy call processes one byte of every piece. So a piece takes about 100 ns; in `link.decoder`,
which decodes one piece at a time, a piece takes microseconds.
"""

import zlib

import numpy as np

from spots_device.reading.decode import CRC_SIZE

# Bytes of the longest piece. In a longer piece, a COBS group may end without a zero.
SIZE_MAX = 254


def _tables() -> np.ndarray:
    # CRC-32 is linear: the CRC of a piece is the CRC of as many zero bytes, plus (XOR) a table
    # entry for each byte, which depends on the byte's value and on the number of bytes after it.
    crc_of_zero = zlib.crc32(b"\0")
    tables = [np.array([zlib.crc32(bytes([i])) ^ crc_of_zero for i in range(256)], np.uint32)]
    for _ in range(SIZE_MAX):
        tables.append(tables[-1] >> 8 ^ tables[0][tables[-1] & 0xFF])
    return np.array(tables)


_TABLES = _tables()


def payloads(data: np.ndarray, starts: np.ndarray, size: int) -> tuple[np.ndarray, np.ndarray]:
    """Decode COBS and check the CRC of m pieces of one size that begin at indices of a stream.

    No byte of a piece may be zero; `size` is from `CRC_SIZE` + 1 to `SIZE_MAX`. Returned are the
    payloads of the valid pieces without the CRC, one a column, and whether each piece is valid,
    shape (m,).
    """
    columns = np.empty((size - 1, len(starts)), np.uint8)
    ahead = data.take(starts)  # distance of the next COBS code byte
    for j, column in enumerate(columns, 1):
        data[j:].take(starts, out=column, mode="clip")  # unlike "raise", it needs no copy
        ahead -= 1
        code = column * (ahead == 0)
        column -= code  # in place of a code byte, the payload has a zero
        ahead += code
    good = ahead == 1  # the last group must end with the piece
    columns, ends = columns[:-CRC_SIZE], columns[-CRC_SIZE:]
    crc = np.full(len(starts), zlib.crc32(bytes(len(columns))), np.uint32)
    for table, column in zip(_TABLES[: len(columns)][::-1], columns):
        crc ^= table.take(column)
    for i, end in enumerate(ends):
        good &= (crc >> 8 * i).astype(np.uint8) == end
    return columns if good.all() else columns[:, good], good
