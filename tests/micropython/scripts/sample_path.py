"""Runs the firmware's loop with prepared registers, and prints the bytes that it sends.

Reads these items from given.json. ``settings``, ``uses`` and ``layout``: settings and key layout
at the start. ``calibrations``: lists of lines. ``scenes``: see `play`. ``port_bytes``: size of the
memory for sent bytes. ``contacts``: whether CONTACT frames are streamed. ``lock``: whether the heap
is locked during the scenes. The script prints one line for each scene, a line with the USB reports,
and the number of bytes that are allocated after the scenes but were not before.
"""

import gc
import json
from binascii import hexlify

from locked import locked

import canned
from spots_device.board.store import Store
from spots_device.reading.calibration import Calibration

_ASTATUS = 0x94
_ASAT = 0x80
_LED = 0x74
_LED_ON = 0x80
# Age of the board at the start: its ticks and its time wrap during the scenes.
_AGE_US = (1 << 32) - 1_000_000
_STALL_US = 1 << 28  # the board time must be updated at least every 2**28 us
_WARM_UP_US = 150_000
_PIECE_BYTES = 64


class Port:
    """Substitute for a serial port; stores written bytes, but refuses them if `takes` is false."""

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
    """Substitute for a USB stack; stores reports, and refuses two of three offers of a report."""

    def __init__(self, size):
        self.kept = Port(size)
        self.offers = 0

    def open(self, names):
        return dict.fromkeys(names, self.send)

    def send(self, report):
        self.offers += 1
        return self.offers % 3 == 0 and self.kept.write(report, len(report))


def temperature_mC():
    """Return a temperature that depends on the time, in units of 0.001 degrees Celsius."""
    return 10_000 + (clock.now >> 15 & 16383)


def step_for(lasts_us, lit, dark):
    """Run the loop for `lasts_us`; the counts are `lit` while the LED is on, otherwise `dark`."""
    until = clock.ticks_add(clock.now, lasts_us)
    while clock.ticks_diff(until, clock.now) > 0:
        bus.counts(lit if bus.registers[_LED] & _LED_ON else dark)
        board.step()


def play(scenes, ends):
    """Run the scenes; store in `ends` how many bytes were sent up to the end of each scene.

    A scene is a dict. ``lit`` and ``dark``: six counts with the LED on and off. ``calibration``:
    index. ``average``: samples in a reading. ``lasts_ms``: duration. ``request_dark``: whether to
    request a dark frame. ``saturated``: whether the chip reports saturation. ``port_takes``:
    whether the port accepts bytes. ``stall_us``: pause before the scene.
    """
    for i in range(len(scenes)):
        scene = scenes[i]
        if strip.decode.calibration is not calibrations[scene["calibration"]]:
            strip.use_calibration(calibrations[scene["calibration"]])
            app.outputs.apply(strip.decode.calibration)
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
    """Print the bytes `begin` to `end` that `port` has stored, in hexadecimal, in one line."""
    while begin < end:
        piece = min(_PIECE_BYTES, end - begin)
        print(hexlify(port.kept[begin : begin + piece]).decode(), end="")
        begin += piece
    print()


def allocated_by(scenes, ends):
    """Run the scenes; return how many more bytes are allocated after them than before."""
    count = getattr(gc, "mem_alloc", int)  # CPython does not count: always 0
    gc.collect()
    before = count()
    if given["lock"]:
        locked(play, scenes, ends)
    else:
        gc.disable()
        play(scenes, ends)
    allocated = count() - before
    gc.enable()  # what follows prints the frames
    return allocated


with open("given.json") as file:
    given = json.load(file)
port = Port(given["port_bytes"])
usb = Usb(given["port_bytes"] // 4)
Store().save([("settings", given["uses"]), ("layout", given["layout"])])
board, bus, clock, _ = canned.app((), port, usb)
app = board.strips[0]
strip = app.strip
strip.sensor.thermometer = temperature_mC
calibrations = []
while given["calibrations"]:  # popped to free memory: a board never stores so many calibrations
    lines = given["calibrations"].pop(0)
    calibrations.append(Calibration(lines) if lines else None)
app.outputs.streams_contacts = given["contacts"]
for calibration in calibrations:
    app.outputs.apply(calibration)  # imports the modules of functions that are switched on
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
