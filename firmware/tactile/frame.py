"""Frames, board to host: COBS(payload, CRC-16) and a zero byte. See docs/protocol.md.

The layouts below are the one place where both ends look them up. The board's 32-bit time is
written as two halves, since a small int holds 31 bits. Packing and sending allocate nothing.
"""

from array import array
from struct import pack_into

from .decode import DROPPED

TOUCH = 1
SPECTRUM = 2
TEXT = 3
KEY = 4

# kind and sensor, sequence, time low, time high
HEADER = "<BHHH"
HEADER_SIZE = 7
TOUCH_BODY = "BiiiH"  # flags, contrast, brightness, position_um, force_mN
SPECTRUM_BODY = "BB6H"  # flags, gain, counts
KEY_BODY = "BBB"  # usage, modifiers, pressed
TEXT_MAX = 500

_DELIMITER = b"\0"
_TOUCH_FRAME = HEADER + TOUCH_BODY
_TOUCH_SIZE = HEADER_SIZE + 15
_SPECTRUM_FRAME = HEADER + SPECTRUM_BODY
_SPECTRUM_SIZE = HEADER_SIZE + 14
_KEY_FRAME = HEADER + KEY_BODY
_KEY_SIZE = HEADER_SIZE + 3


def _crc_table():
    # CRC-16/CCITT-FALSE, polynomial 0x1021, as binascii.crc_hqx of CPython.
    table = array("H", bytes(512))
    for byte in range(256):
        crc = byte << 8
        for _ in range(8):
            crc = (crc << 1 ^ 0x1021) if crc & 0x8000 else crc << 1
        table[byte] = crc & 0xFFFF
    return table


_CRC = _crc_table()


def crc16(data, size, crc=0xFFFF):
    """Return the CRC-16/CCITT-FALSE of the first `size` bytes."""
    table = _CRC
    for i in range(size):
        crc = (crc << 8 & 0xFF00) ^ table[crc >> 8 ^ data[i]]
    return crc


def cobs_encode(source, size, target):
    """Write the COBS form of the first `size` bytes and its zero byte; return its length."""
    code_at = 0
    write = 1
    for read in range(size):
        byte = source[read]
        if byte:
            target[write] = byte
            write += 1
        if not byte or write - code_at == 255:
            target[code_at] = write - code_at
            code_at = write
            write += 1
    target[code_at] = write - code_at
    target[write] = 0
    return write + 1


class Time32:
    """Board time in us modulo 2**32, kept as two halves of 16 bits.

    Parameters
    ----------
    clock : object
        ``ticks_us`` and ``ticks_diff``; must be asked at least every 2**28 us.
    """

    def __init__(self, clock):
        self._diff = clock.ticks_diff
        self._last = clock.ticks_us()
        self.low = self.high = 0

    def set(self, ticks):
        """Move to `ticks`, which may lie before the last ones."""
        low = self.low + self._diff(ticks, self._last)
        self._last = ticks
        self.high = (self.high + (low >> 16)) & 0xFFFF
        self.low = low & 0xFFFF


class Framer:
    """Numbers frames and hands them, whole, to a serial port.

    Parameters
    ----------
    serial : object
        ``write(buffer, size) -> bool``: True if the bytes went out, False if they were dropped.
    time : Time32
        What the header's time is read from.
    """

    def __init__(self, serial, time):
        self._write = serial.write
        self._time = time
        self._sequence = 0
        self._payload = bytearray(HEADER_SIZE + TEXT_MAX + 2)
        self._encoded = bytearray(len(self._payload) + 6)
        self._gap = 0
        self.dropped = 0

    def gap(self):
        """Mark the next frame: something before it is missing."""
        self._gap = DROPPED

    def touch(self, sensor, decode):
        """Send a TOUCH frame with the attributes of a `decode.Decode`."""
        pack_into(
            _TOUCH_FRAME,
            self._payload,
            0,
            TOUCH | sensor << 4,
            self._sequence,
            self._time.low,
            self._time.high,
            decode.flags | self._gap,
            decode.contrast,
            decode.brightness,
            decode.position_um,
            decode.force_mN,
        )
        return self._send_flagged(_TOUCH_SIZE)

    def spectrum(self, sensor, flags, gain, counts):
        """Send a SPECTRUM frame with six counts of 16 bits."""
        pack_into(
            _SPECTRUM_FRAME,
            self._payload,
            0,
            SPECTRUM | sensor << 4,
            self._sequence,
            self._time.low,
            self._time.high,
            flags | self._gap,
            gain,
            counts[0],
            counts[1],
            counts[2],
            counts[3],
            counts[4],
            counts[5],
        )
        return self._send_flagged(_SPECTRUM_SIZE)

    def key(self, sensor, usage, modifiers, pressed):
        """Send a KEY frame: a HID keyboard usage goes down or up."""
        pack_into(
            _KEY_FRAME,
            self._payload,
            0,
            KEY | sensor << 4,
            self._sequence,
            self._time.low,
            self._time.high,
            usage,
            modifiers,
            1 if pressed else 0,
        )
        return self._send(_KEY_SIZE)

    def text(self, data):
        """Send a TEXT frame with at most `TEXT_MAX` bytes. Allocates."""
        payload = self._payload
        pack_into(HEADER, payload, 0, TEXT, self._sequence, self._time.low, self._time.high)
        payload[HEADER_SIZE : HEADER_SIZE + len(data)] = data
        return self._send(HEADER_SIZE + len(data))

    def _send_flagged(self, size):
        sent = self._send(size)
        if sent:
            self._gap = 0
        return sent

    def _send(self, size):
        payload = self._payload
        crc = crc16(payload, size)
        payload[size] = crc & 0xFF
        payload[size + 1] = crc >> 8
        length = cobs_encode(payload, size + 2, self._encoded)
        if length & 63 == 0:
            # USB CDC stalls on exact multiples of its packet; an empty frame is skipped.
            self._encoded[length] = 0
            length += 1
        self._sequence = (self._sequence + 1) & 0xFFFF
        # What was dropped may have been cut short: without a delimiter it would swallow this one.
        if (not self._gap or self._write(_DELIMITER, 1)) and self._write(self._encoded, length):
            return True
        self._gap = DROPPED
        self.dropped += 1
        return False
