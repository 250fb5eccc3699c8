"""Frames from board to host: COBS(payload, CRC-32) and a zero byte. See docs/extend/protocol.md.

Board and host both use the formats in this module. The board's 32-bit time is written as two
halves, because a small int has 31 bits. Packing and sending allocate nothing.
"""

from array import array
from struct import pack_into

from .. import const
from ..sensor.smux import CHANNELS
from . import decode as d
from .kernel import frame

TOUCH = 1
SPECTRUM = 2
TEXT = 3
KEY = 4
CONTACT = 5

# Flags, gain code, six counts, and the words of `Framer.spectrum`.
SPECTRUM_BODY = "<BB6H6IiB"
KEY_BODY = "<BHBB"  # usage page, usage, modifiers, pressed
CONTACT_BODY = "<BBiHH"  # id, state, position_um, sigma_um, force_mN
TEXT_MAX = 888  # bytes; the longest reply is that to `hello`

# Words of what was taken off the counts, see `Framer.spectrum`. The first six are the light.
TEMPERATURE_MC = 6  # temperature to which the tables of the calibration are shifted
CONTEXT = 7  # bits, see below
TAKEN_OFF_SIZE = 8
UNKNOWN_MC = -1048576
CHANGING = 1  # the ambient light changes, so the light is an estimate
TWO = 2  # keys or contacts have seen two fingers

# Bytes of the bodies.
_KEY = const(5)
_CONTACT = const(10)


class Time32:
    """Board time in us modulo 2**32, stored as two halves of 16 bits in the header of frames.

    `set` or `update` must be called at least every 2**28 us.
    """

    def __init__(self, clock):
        self._ticks_us = clock.ticks_us
        self._diff = clock.ticks_diff
        self.last = clock.ticks_us()  # at the time in `head` plus its `LESS_US`
        self.head = array("i", bytes(4 * d.HEAD_SIZE))  # header of the next frame, `decode.KIND`

    def set(self, ticks):
        """Set the time to `ticks`; the new time may be earlier than the present one."""
        head = self.head
        low = head[d.TIME_LOW] + head[d.LESS_US] + self._diff(ticks, self.last)
        self.last = ticks
        head[d.LESS_US] = 0
        head[d.TIME_HIGH] = head[d.TIME_HIGH] + (low >> 16) & 0xFFFF
        head[d.TIME_LOW] = low & 0xFFFF

    def update(self):
        """Set the time to the present ticks of the clock."""
        self.set(self._ticks_us())

    def ticks(self):
        """Return the time in units of 1024 us, see `tracker.TICK_US`; 22 bits, so it wraps."""
        return self.head[d.TIME_HIGH] << 6 | self.head[d.TIME_LOW] >> 10

    def us(self):
        """Return the board time in us; allocates if it does not fit a small integer."""
        return self.head[d.TIME_HIGH] << 16 | self.head[d.TIME_LOW]


class Framer:
    """Encodes and numbers frames, and sends them to a serial port."""

    def __init__(self, serial, time):
        self._write = serial.write  # returns False if it has dropped the bytes
        self._head = time.head
        self.payload = bytearray(d.HEADER_SIZE + TEXT_MAX + d.CRC_SIZE)
        # A delimiter, and the encoded frame.
        self._delimited = memoryview(bytearray(len(self.payload) + 7))
        self.encoded = self._delimited[1:]
        self.dropped = 0  # frames that were not sent

    def spectrum(self, sensor, flags, gain, counts, taken_off):
        """Send a SPECTRUM frame; return whether it was sent.

        `taken_off` has what a reading subtracts from the six counts, in units of 1/64 count, then
        the words `TEMPERATURE_MC` and `CONTEXT`.
        """
        payload = self.payload
        payload[d.HEADER_SIZE] = flags | self._head[d.GAP]
        payload[d.HEADER_SIZE + 1] = gain
        at = d.HEADER_SIZE + 2
        for i in range(CHANNELS):
            pack_into("<H", payload, at, counts[i])
            at += 2
        for i in range(CONTEXT):
            pack_into("<i", payload, at, taken_off[i])
            at += 4
        payload[at] = taken_off[CONTEXT]
        self._head[d.KIND] = SPECTRUM | sensor << 4
        return self.send(frame(self._head, payload, at + 1, self.encoded))

    def key(self, sensor, page, usage, modifiers, pressed):
        """Send a key event as a KEY frame; return whether it was sent.

        `sensor` is the number of the sensor. The other arguments are those of
        `merge.Merger`'s ``sink.key``.
        """
        pack_into(KEY_BODY, self.payload, d.HEADER_SIZE, page, usage, modifiers, int(pressed))
        return self._send_body(KEY | sensor << 4, d.HEADER_SIZE + _KEY)

    def contact(self, sensor, finger, state, position_um, sigma_um, force_mN):
        """Send a finger as a CONTACT frame; docs/extend/protocol.md describes the arguments."""
        pack_into(
            CONTACT_BODY,
            self.payload,
            d.HEADER_SIZE,
            finger,
            state,
            position_um,
            sigma_um,
            force_mN,
        )
        return self._send_body(CONTACT | sensor << 4, d.HEADER_SIZE + _CONTACT)

    def text(self, data):
        """Send `data`, at most `TEXT_MAX` bytes, as a TEXT frame; return whether it was sent.

        Allocates.
        """
        self.payload[d.HEADER_SIZE : d.HEADER_SIZE + len(data)] = data
        return self._send_body(TEXT, d.HEADER_SIZE + len(data))

    def _send_body(self, kind, size):
        # Only TOUCH and SPECTRUM frames have flags. So after another frame, the flag `DROPPED`
        # remains set for the next TOUCH or SPECTRUM frame.
        head = self._head
        head[d.KIND] = kind
        gap = head[d.GAP]
        size = frame(head, self.payload, size, self.encoded)
        if not self.send(size):
            return False
        head[d.GAP] = gap
        return True

    def send(self, length):
        """Send the first `length` bytes of `encoded`; return whether they were sent."""
        head = self._head
        encoded = self.encoded
        if head[d.GAP]:
            head[d.GAP] = 0
            # A part of the dropped frame may have been sent. Without a delimiter after this part,
            # the present frame would be lost too. Delimiter and frame are sent in one write,
            # because the port would refuse a second write after a slow one.
            encoded = self._delimited
            length += 1
        if self._write(encoded, length):
            return True
        head[d.GAP] = d.DROPPED
        self.dropped += 1
        return False
