"""COBS and CRC-32 of many pieces of one size at once: a step for each byte, not for each piece.

It gives what `frames` gives piece by piece, at about 100 ns a piece instead of microseconds.
"""

from __future__ import annotations

import zlib

import numpy as np

from spots_device.kernel import CRC_SIZE

# A longer piece may have groups without a zero behind them, for which one byte count is too small.
SIZE_MAX = 254
# CRC-32 is linear: that of a text is that of as many zeros, and for each byte one entry by its
# value and by how many bytes follow it.
_POLYNOMIAL = 0xEDB88320


def _tables() -> np.ndarray:
    first = np.arange(256, dtype=np.uint32)
    for _ in range(8):
        first = first >> 1 ^ (first & 1) * np.uint32(_POLYNOMIAL)
    tables = [first]
    for _ in range(SIZE_MAX):
        tables.append(tables[-1] >> 8 ^ first[tables[-1] & 0xFF])
    return np.array(tables)


_TABLES = _tables()


def payloads(data: np.ndarray, starts: np.ndarray, size: int) -> tuple[np.ndarray, np.ndarray]:
    """Undo COBS and check the CRC of pieces of one size.

    Parameters
    ----------
    data : ndarray, shape (n,), uint8
        Bytes of a stream.
    starts : ndarray, shape (m,), intp
        Where each piece begins. No byte of it may be zero.
    size : int
        Bytes of each piece, `CRC_SIZE` + 1 to `SIZE_MAX`.

    Returns
    -------
    columns : ndarray, shape (size - 1 - CRC_SIZE, count of good pieces), uint8
        Payloads without the CRC, the first byte of each in the first row.
    good : ndarray, shape (m,), bool
        Whether the piece is whole and its CRC right.
    """
    columns = np.empty((size - 1, len(starts)), np.uint8)
    ahead = data.take(starts)  # how far the next code byte is
    for j, column in enumerate(columns, 1):
        data[j:].take(starts, out=column, mode="clip")  # unlike "raise", it needs no copy
        ahead -= 1
        code = column * (ahead == 0)
        column -= code  # where it stands, the payload has a zero
        ahead += code
    good = ahead == 1  # the last group ends with the piece
    columns, ends = columns[:-CRC_SIZE], columns[-CRC_SIZE:]
    crc = np.full(len(starts), zlib.crc32(bytes(len(columns))), np.uint32)
    for table, column in zip(_TABLES[: len(columns)][::-1], columns):
        crc ^= table.take(column)
    for i, end in enumerate(ends):
        good &= (crc >> 8 * i).astype(np.uint8) == end
    return columns if good.all() else columns[:, good], good
