"""Frames, board to host: COBS(payload, CRC-32) and a zero byte. See docs/protocol.md.

Board and host both use the layouts in this module. The board's 32-bit time is written as two
halves, because a small int has 31 bits. Packing and sending allocate nothing.
"""

from struct import pack_into

from .decode import DROPPED
from .kernel import CRC_SIZE, frame

TOUCH = 1
SPECTRUM = 2
TEXT = 3
KEY = 4
CONTACT = 5

# kind and sensor, sequence, time low, time high
HEADER = "<BHHH"
HEADER_SIZE = 7
TOUCH_BODY = "BiiiH"  # flags, contrast, brightness, position_um, force_mN
SPECTRUM_BODY = "BB6H"  # flags, gain, counts
KEY_BODY = "BHBB"  # usage page, usage, modifiers, pressed
CONTACT_BODY = "BBiHH"  # id, state, position_um, sigma_um, force_mN
TEXT_MAX = 640  # bytes; the longest reply, to `get`, has 602

_TOUCH_FRAME = HEADER + TOUCH_BODY
_TOUCH_SIZE = HEADER_SIZE + 15
_SPECTRUM_FRAME = HEADER + SPECTRUM_BODY
_SPECTRUM_SIZE = HEADER_SIZE + 14
_KEY_FRAME = HEADER + KEY_BODY
_KEY_SIZE = HEADER_SIZE + 5
_CONTACT_FRAME = HEADER + CONTACT_BODY
_CONTACT_SIZE = HEADER_SIZE + 10


class Time32:
    """Board time in us modulo 2**32, stored as two halves of 16 bits.

    Parameters
    ----------
    clock : object
        ``ticks_us`` and ``ticks_diff``. `set` or `update` must be called at least every 2**28 us.
    """

    def __init__(self, clock):
        self._ticks_us = clock.ticks_us
        self._diff = clock.ticks_diff
        self._last = clock.ticks_us()
        self.low = self.high = 0

    def set(self, ticks):
        """Set the time to that of `ticks`, which may be earlier than the present time."""
        low = self.low + self._diff(ticks, self._last)
        self._last = ticks
        self.high = (self.high + (low >> 16)) & 0xFFFF
        self.low = low & 0xFFFF

    def update(self):
        """Set the time to the present ticks of the clock."""
        self.set(self._ticks_us())

    def us(self):
        """Return the board time in us; allocates if it does not fit a small integer."""
        return self.high << 16 | self.low


class Framer:
    """Encodes and numbers frames, and sends them to a serial port.

    Parameters
    ----------
    serial : object
        ``write(buffer, size) -> bool``: True if the bytes were sent, False if they were dropped.
    time : Time32
        Board time for the header of each frame.
    """

    def __init__(self, serial, time):
        self._write = serial.write
        self._time = time
        self._sequence = 0
        self._payload = bytearray(HEADER_SIZE + TEXT_MAX + CRC_SIZE)
        self._encoded = bytearray(len(self._payload) + 6)
        self._gap = 0
        self.dropped = 0

    def gap(self):
        """Set the flag `DROPPED` in the next frame, because samples before it are missing."""
        self._gap = DROPPED

    def touch(self, sensor, decode):
        """Send the reading in `decode` as a TOUCH frame; return whether it was sent."""
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
        return self._send(_TOUCH_SIZE, 0)

    def spectrum(self, sensor, flags, gain, counts):
        """Send six 16-bit counts, flags and gain code as a SPECTRUM frame; return whether sent."""
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
        return self._send(_SPECTRUM_SIZE, 0)

    def key(self, sensor, page, usage, modifiers, pressed):
        """Send a key event as a KEY frame, see `uses.Uses.key`; return whether it was sent."""
        pack_into(
            _KEY_FRAME,
            self._payload,
            0,
            KEY | sensor << 4,
            self._sequence,
            self._time.low,
            self._time.high,
            page,
            usage,
            modifiers,
            1 if pressed else 0,
        )
        return self._send(_KEY_SIZE, self._gap)

    def contact(self, sensor, finger, state, position_um, sigma_um, force_mN):
        """Send a finger as a CONTACT frame; docs/protocol.md describes the arguments."""
        pack_into(
            _CONTACT_FRAME,
            self._payload,
            0,
            CONTACT | sensor << 4,
            self._sequence,
            self._time.low,
            self._time.high,
            finger,
            state,
            position_um,
            sigma_um,
            force_mN,
        )
        return self._send(_CONTACT_SIZE, self._gap)

    def text(self, data):
        """Send at most `TEXT_MAX` bytes as a TEXT frame; return whether it was sent. Allocates."""
        payload = self._payload
        pack_into(HEADER, payload, 0, TEXT, self._sequence, self._time.low, self._time.high)
        payload[HEADER_SIZE : HEADER_SIZE + len(data)] = data
        return self._send(HEADER_SIZE + len(data), self._gap)

    def _send(self, size, gap_after):
        # `gap_after`: the gap that remains to be marked once this frame is sent. Only TOUCH and
        # SPECTRUM frames have flags, so all other frames leave the gap to a later frame.
        length = frame(self._payload, size, self._encoded)
        if length & 63 == 0:
            # USB CDC stalls on exact multiples of its packet; an empty frame is skipped.
            self._encoded[length] = 0
            length += 1
        self._sequence = (self._sequence + 1) & 0xFFFF
        # A part of the dropped frame may have been sent. Without a delimiter after this part, the
        # present frame would be lost too.
        if (not self._gap or self._write(b"\0", 1)) and self._write(self._encoded, length):
            self._gap = gap_after
            return True
        self._gap = DROPPED
        self.dropped += 1
        return False
