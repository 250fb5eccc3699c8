"""MicroPython's I2C bus and serial port."""

import select
import sys
import time
from errno import EIO
from time import ticks_diff, ticks_us

import machine

from .. import const
from .common import ADDRESS, HALF_CLOCK_US, free_bus

_I2C_TIMEOUT_US = const(50_000)
_CTRL_C = const(3)
_POLLIN = const(1)  # as in `select`
_POLLOUT = const(4)
# All writes have this size, which divides the sizes of MicroPython's USB buffer (256 or 512 bytes)
# and of a USB packet (64 bytes). A TOUCH, KEY or CONTACT frame fits in; a SPECTRUM frame needs two.
_BLOCK = const(32)
_TWO = const(64)
_ZEROS = b"\0" * _BLOCK
_STALL_US = const(10_000)  # longest wait for the host to read the next block of a frame
_STEP_US = const(200)
# A write that takes longer is slow; if the host does not read, a write blocks for half a second.
_SLOW_US = const(200_000)
# Back-off after a slow write: first pause, factor for each further slow write, and longest pause.
# The first pause is short, because a single write may be slow for another reason.
_PAUSE_US = const(1_000)
_PAUSE_TIMES = const(16)
_PAUSE_MAX_US = const(64_000_000)


class MachineBus:
    """Reads and writes the sensor's registers over ``machine.I2C``. Transfers allocate nothing."""

    def __init__(self, id, scl, sda, freq):
        self._pins = scl, sda
        self._options = id, freq
        self._open()

    def write(self, buffer):
        # An RP2040 raises no OSError if the chip does not acknowledge a data byte.
        if self.write_to(ADDRESS, buffer) != len(buffer):
            raise OSError(EIO)

    def recover(self):
        """Free the wires of the I2C bus, and open the I2C controller again."""
        scl, sda = [
            machine.Pin(pin, machine.Pin.OPEN_DRAIN, machine.Pin.PULL_UP, value=1)
            for pin in self._pins
        ]
        free_bus(scl, sda, machine.Pin.value, _put)
        self._open()

    def _open(self):
        scl, sda = map(machine.Pin, self._pins)
        id, freq = self._options
        i2c = machine.I2C(id, scl=scl, sda=sda, freq=freq, timeout=_I2C_TIMEOUT_US)
        self.read_into = i2c.readfrom_mem_into  # each method in Python would take longer
        self.write_to = i2c.writeto


def _put(pin, level):
    pin.value(level)
    time.sleep_us(HALF_CLOCK_US)


class StdioSerial:
    """The USB serial port behind stdin and stdout.

    Frames are written to ``sys.stdout.buffer``, because ``sys.stdout`` adds a CR to every LF. Each
    direction has its own poll object, because `ipoll` then allocates only at its first call.

    If the buffer of the port has no room for a write, the write blocks for half a second. The poll
    only shows whether there is room for at least one byte. So all writes have the same size, a
    block: USB takes whole packets out of the buffer, and the buffer is empty at the first packet
    that is not full. So the room in the buffer is always a multiple of a block, and a write never
    blocks. Zero bytes after a frame complete its block; the host ignores them.

    The port of an ESP32 is always writable, and so is the port of a sleeping host. A write then
    blocks. So after a slow write, no frame is sent for a back-off time, or until the host sends a
    byte.
    """

    def __init__(self):
        self._out = sys.stdout.buffer.write
        self._in = sys.stdin.buffer
        self._byte = bytearray(1)
        poll = select.poll()
        poll.register(sys.stdout, select.POLLOUT)
        self._ipoll = poll.ipoll
        readable = select.poll()
        readable.register(sys.stdin, select.POLLIN)
        self._ready = readable.ipoll
        self._pause_us = self._from = self._size = 0

    def write(self, buffer, size):
        """Write a frame if the port has room; return whether it was sent completely.

        A frame that fits a block is written at once or not at all; the second block of a frame
        waits 10 ms at most for the host to read. Both allocate nothing. Bytes of `buffer` after the
        frame, up to the end of its block and one more, are overwritten by zeros.
        """
        if size > _TWO:
            return self._write_long(buffer, size)
        if size != self._size:
            self._pad(buffer, size)
        if self._pause_us:
            # The port of a host that has just woken up is full, and only a write starts it again.
            if self._is_paused():
                return False
        elif not self._has_room():
            return False
        began = ticks_us()
        sent = self._put(buffer)
        if ticks_diff(ticks_us(), began) < _SLOW_US:
            self._pause_us = 0
            if sent != _BLOCK or size <= _BLOCK:
                return sent == _BLOCK
            return self._put_second(buffer)
        if size > _BLOCK:  # the first block may have been sent, and then the frame is whole
            self._put_second(buffer)
        self._pause_us = min(_PAUSE_TIMES * self._pause_us or _PAUSE_US, _PAUSE_MAX_US)
        self._from = time.ticks_add(ticks_us(), self._pause_us)
        return False

    # Methods of their own, because each call frame must have at most 11 words, see strip.py.

    def _pad(self, buffer, size):
        # After a frame of the same size, the bytes are 0 already.
        self._size = size
        for i in range(size, (_BLOCK if size <= _BLOCK else _TWO) + 1):
            buffer[i] = 0

    def _is_paused(self):
        # Ticks wrap, so a time in the far past looks like a time in the future.
        return 0 < ticks_diff(self._from, ticks_us()) <= self._pause_us

    def _has_room(self):
        for event in self._ipoll(0):
            return event[1] & _POLLOUT
        return False

    def _put(self, block):
        try:
            # Older versions of MicroPython return the size even if they have dropped the bytes.
            return self._out(block, _BLOCK)
        except OSError:
            return 0

    def _put_second(self, buffer):
        began = ticks_us()
        while not self._has_room():
            if ticks_diff(ticks_us(), began) >= _STALL_US:
                return False
            time.sleep_us(_STEP_US)
        try:
            return self._out(buffer, _BLOCK, _BLOCK) == _BLOCK
        except OSError:
            return False

    def _write_long(self, buffer, size):
        """Write a TEXT frame block by block; wait 10 ms at most for the host to read. Allocates.

        If there is no room for the first block, nothing is sent.
        """
        if self._is_paused():
            return False
        text = bytes(buffer[:size]) + _ZEROS[: -size % _BLOCK]
        self._size = _BLOCK
        for at in range(0, size, _BLOCK):
            began = ticks_us()
            while at and not self._has_room():
                if ticks_diff(ticks_us(), began) >= _STALL_US:
                    return False
                time.sleep_us(_STEP_US)
            if not self.write(text[at : at + _BLOCK], _BLOCK):
                if self._pause_us and at == 0:
                    # A slow write; its bytes may have been sent. With the rest, the reply is whole.
                    try:
                        self._out(text[_BLOCK:])
                    except OSError:
                        pass
                return False
        return True

    def read(self):
        """Return the next byte from the host, or -1 if no byte waits.

        A USB port raises KeyboardInterrupt at Ctrl-C by itself; for other ports, this method raises
        KeyboardInterrupt.
        """
        for _, event in self._ready(0):
            if event & _POLLIN and self._in.readinto(self._byte) == 1:
                if self._byte[0] == _CTRL_C:
                    raise KeyboardInterrupt
                if self._pause_us:
                    self._from = ticks_us()  # ends the pause
                return self._byte[0]
        return -1
