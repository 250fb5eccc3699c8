"""Runs the firmware's loop with prepared registers, and prints the bytes that it sends.

Reads from given.json: ``settings``, ``calibrations``, ``scenes`` (see `play`), ``port_bytes`` for
what the port is to keep, ``contacts``: whether to stream them, ``uses`` and ``layout``: settings
and keys at the start, and ``lock``: whether the heap is locked meanwhile. The last line but one has
the USB reports; the last one is how many bytes more are allocated after the scenes than before.
"""

import gc
import json
from binascii import hexlify

from locked import locked

import canned
from spots_device.calibration import Calibration
from spots_device.settings import save_lines

_ASTATUS = 0x94
_ASAT = 0x80
_LED = 0x74
_LED_ON = 0x80
# A board that has run so long that its ticks and its time wrap while the scenes are played.
_AGE_US = (1 << 32) - 1_000_000
_STALL_US = 1 << 28  # board time has to be asked for at least that often
_WARM_UP_US = 150_000
_PIECE_BYTES = 64


class Port:
    """A serial port that stores all that is written while `takes` is true."""

    def __init__(self, size):
        self.kept = bytearray(size)
        self.size = 0
        self.takes = True

    def write(self, buffer, size):
        if self.takes:
            for i in range(size):
                self.kept[self.size + i] = buffer[i]
            self.size += size
        return self.takes

    def read(self):
        return -1


class Usb:
    """USB interfaces that store their reports; they refuse two of three offers."""

    def __init__(self, size):
        self.kept = Port(size)
        self.offers = 0

    def open(self, names):
        return dict.fromkeys(names, self.send)

    def send(self, report):
        self.offers += 1
        return self.offers % 3 == 0 and self.kept.write(report, len(report))


def step_for(lasts_us, lit, dark):
    """Run the loop for some time; the counts are dark while the LED is off."""
    until = clock.ticks_add(clock.now, lasts_us)
    while clock.ticks_diff(until, clock.now) > 0:
        bus.counts(lit if bus.registers[_LED] & _LED_ON else dark)
        app.step()


def play(scenes, ends):
    """Run the scenes; record how many bytes were sent up to the end of each."""
    for i in range(len(scenes)):
        scene = scenes[i]
        if strip.decode.calibration is not calibrations[scene["calibration"]]:
            strip.decode.calibration = calibrations[scene["calibration"]]
            app.uses.apply(strip.decode.calibration)
        strip.settings.values["average"] = scene["average"]
        strip.configure()
        if scene["request_dark"]:
            strip.request_dark(None)
        bus.registers[_ASTATUS] = _ASAT if scene["saturated"] else 0
        port.takes = scene["port_takes"]
        clock.sleep_us(scene["stall_us"])
        step_for(1000 * scene["lasts_ms"], scene["lit"], scene["dark"])
        ends[i] = port.size


def print_kept(port, begin, end):
    """Print the stored bytes in one line."""
    while begin < end:
        piece = min(_PIECE_BYTES, end - begin)
        print(hexlify(port.kept[begin : begin + piece]).decode(), end="")
        begin += piece
    print()


def allocated_by(scenes, ends):
    """Run the scenes, and return how many bytes they have left allocated."""
    count = getattr(gc, "mem_alloc", int)  # CPython does not count: always 0
    gc.collect()
    before = count()
    if given["lock"]:
        locked(play, scenes, ends)
    else:
        gc.disable()
        play(scenes, ends)
    return count() - before


with open("given.json") as file:
    given = json.load(file)
port = Port(given["port_bytes"])
usb = Usb(given["port_bytes"] // 4)
save_lines("settings.txt", given["uses"])
save_lines("layout.txt", given["layout"])
app, bus, clock, _ = canned.app((), port, usb)
strip = app.strip
calibrations = []
while given["calibrations"]:  # popped: a board has never so many at once
    lines = given["calibrations"].pop(0)
    calibrations.append(Calibration(lines) if lines else None)
app.uses.streams_contacts = given["contacts"]
for calibration in calibrations:
    app.uses.apply(calibration)  # loads what is switched on
first = given["scenes"][0]
left_us = _AGE_US - clock.now
while left_us > 0:
    stall_us = max(0, min(_STALL_US, left_us) - _WARM_UP_US)
    clock.sleep_us(stall_us)
    step_for(_WARM_UP_US, first["lit"], first["dark"])
    left_us -= stall_us + _WARM_UP_US
app.settings.change(given["settings"])
app.restart()
step_for(_WARM_UP_US, first["lit"], first["dark"])

port.size = 0
usb.kept.size = 0
ends = [0] * len(given["scenes"])
allocated = allocated_by(given["scenes"], ends)
begin = 0
for end in ends:
    print_kept(port, begin, end)
    begin = end
print_kept(usb.kept, 0, usb.kept.size)
print(allocated)
