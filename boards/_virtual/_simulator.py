"""Sends requests to the simulator over a pipe; a second pipe returns answers with the time.

`_protocol` describes the bytes of requests and answers. This module allocates nothing, so that
tests can check that the firmware allocates nothing.
"""

import gc
import os
from array import array

import _protocol as p
import utime
from micropython import const

_requests = open("/dev/fd/" + os.getenv("SPOTS_REQUESTS"), "wb")
_answers = open("/dev/fd/" + os.getenv("SPOTS_ANSWERS"), "rb")
_request = bytearray(4 + 256)
_answer = array("i", (0, 0))  # errno and clock
_level = bytearray(1)
_wires = bytearray(b"\x01\x01\x81\x01")  # SCL and SDA: 1 released, 0 pulled low by the board
# Wires of the first bus; those of the second bus follow after `WIRES`.
SCL = const(0)
SDA = const(1)
WIRES = const(2)
STRIP_LED = const(4)  # a pin, not a wire of the bus

simulated_time = os.getenv("SPOTS_CLOCK") == "simulated"
_memory_every = int(os.getenv("SPOTS_MEMORY_EVERY"))
_looks = 0  # calls of `_report_memory`
_busy_us = 0  # processor time that the simulator does not know yet
now_us = 0
radio = None  # called when the firmware sleeps, if its radio is on
waiting = None  # called when the firmware looks at the clock, if a USB report waits


def call(operation, a, b, c, buffer=None):
    """Send a request with arguments a, b, c and read the answer; raise OSError if errno is not 0.

    `buffer` contains the data to send, or receives the data of the answer.
    """
    global now_us
    if _busy_us:
        _report_busy()
    if _memory_every == 1 and operation in (p.READ, p.WRITE):
        _report_memory()
    size = b if operation in p.SENDS else 0
    for i in range(size):
        _request[4 + i] = buffer[i]
    _send(operation, a, b, c, size)
    _receive(_answer, 8)
    now_us = _answer[1]
    if _answer[0]:
        raise OSError(_answer[0])
    if operation in p.READS:
        _receive(buffer, c)


def set_wire(wire, level):
    """Release a wire of an I2C bus (level 1), or pull it low (level 0)."""
    _wires[wire] = _wires[wire] & p.SECOND_BUS | (1 if level else 0)
    sda(wire // WIRES)


def sda(bus=0):
    """Return the level of the wire SDA of I2C bus 0 or 1: 1 for high, 0 for low."""
    call(p.LINES, _wires[WIRES * bus + SCL], _wires[WIRES * bus + SDA], 1, _level)
    return _level[0]


def sleep_us(us):
    """Sleep for `us` microseconds, in real or in simulated time."""
    if radio:
        radio()
    if not simulated_time:
        utime.sleep_us(us)
        return
    _report_memory()
    while us > 0:
        part = min(us, 0xFFFFFF)
        call(p.SLEEP, part & 0xFF, part >> 8 & 0xFF, part >> 16)
        us -= part


def spend_us(us):
    """Advance the clock by `us` microseconds of processor time; only in simulated time."""
    global _busy_us, now_us
    _busy_us += us
    now_us = now_us + us & (p.PERIOD_US - 1)


def _report_busy():
    global _busy_us
    _send(p.BUSY, _busy_us & 0xFF, _busy_us >> 8 & 0xFF, _busy_us >> 16)
    _busy_us = 0


def _report_memory():
    # A request of its own, not a part of a reply of the board: free memory differs between runs,
    # but the board's replies must not.
    global _looks
    _looks += 1
    if _looks % _memory_every == 0:
        free = gc.mem_free()
        _send(p.MEMORY, free & 0xFF, free >> 8 & 0xFF, free >> 16)


def _receive(buffer, size):
    if _answers.readinto(buffer) != size:
        raise SystemExit  # the simulator has ended, so the board ends too


def _send(operation, a, b, c, size=0):
    request = _request
    request[0] = operation
    request[1] = a
    request[2] = b
    request[3] = c
    try:
        _requests.write(request, 4 + size)
    except OSError:
        raise SystemExit  # the simulator has ended; this is not a bus fault
