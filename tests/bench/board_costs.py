"""Measures on a Pico the processor time of the firmware's functions in us; runs on the board.

`bench.board_inputs` writes two files. Copy them to a Pico with firmware and a touched strip:
``mpremote fs rm :main.py + fs cp calibration.inputs readings.inputs :``. Then
``mpremote run tests/bench/board_costs.py`` prints the times for ``host/spots_sim/data/cpus.toml``.

A measured time does not include the other measured functions that the function calls: they are
replaced by empty functions during its measurement.
"""

import gc
import time
from array import array

import board_config
import machine

from spots_device.board import app as app_module
from spots_device.board import command
from spots_device.fingers import evidence
from spots_device.reading.silicone import Compensation
from spots_device.runtime.micropython import MachineBus, StdioSerial
from spots_device.sensor.as7341 import AS7341

ticks, diff = time.ticks_us, time.ticks_diff
_CLEAR = bytes((0x93, 0x08))
_TICKS = 10  # time between two readings, in ticks of tracker.TICK_US


class Null:
    """Substitute for a serial port; accepts and ignores all frames."""

    def write(self, buffer, size):
        return True

    def read(self):
        return -1


class FullBus:
    """Substitute for an I2C bus: the chip always has a new sample, and transfers take no time."""

    def read_into(self, address, register, buffer):
        buffer[0] = 0x08

    def write(self, buffer):
        pass


def nothing(a=0, b=0, c=0, d=0):
    pass


def same(before, after):
    return before


def partial(function, argument):
    return lambda: function(argument)


def mean_us(function, count=200):
    """Return the mean duration of a call in us, without the loop around it; allocates nothing."""
    function()
    gc.collect()
    began = ticks()
    for _ in range(count):
        function()
    return diff(ticks(), began) / count - empty_us


empty_us = 0.0
empty_us = mean_us(nothing)


def show(name, us):
    print("%-44s %9.1f" % (name, us))


show("an empty call", empty_us)
with open("calibration.inputs") as file:
    lines = file.read().split("\n")
uid = "".join("%02x" % byte for byte in machine.unique_id())
lines = ["board " + uid if line.startswith("board ") else line for line in lines]
bus = MachineBus(
    board_config.I2C_ID, board_config.SCL_PIN, board_config.SDA_PIN, board_config.I2C_HZ
)
app = app_module.BoardApp(board_config, "micropython", uid, AS7341(bus, time), time, Null())


def run(ms):
    began = time.ticks_ms()
    while time.ticks_diff(time.ticks_ms(), began) < ms:
        app.step()


app.step()
print(app.use_calibration(lines))
line = lines[3]
del lines
strip = app.strip
strip.stream_touch = True
run(600)
print("reading", list(strip.decode.state)[:8], "free", gc.mem_free())

# Transfers; their times include the time on the bus.
sensor, framer, pacing = strip.sensor, app.framer, strip.sensor.pacing
long, short = bytearray(14), bytearray(1)
for name, call in (
    ("read of 14 bytes", lambda: bus.read_into(0x39, 0x93, long)),
    ("read of 1 byte", lambda: bus.read_into(0x39, 0x93, short)),
    ("write of 2 bytes", lambda: bus.write(_CLEAR)),
):
    show(name, mean_us(call))

# A sample.
sensor.bus = FullBus()
pacing.found = same
show("as7341.AS7341.poll", mean_us(sensor.poll))
del pacing.found
locked = pacing._locked


def found():
    pacing._locked = True
    pacing._was_early = False
    return pacing.found(pacing.due, pacing.due)


show("pacing.Pacing.found, locked", mean_us(found))


def doubt():
    pacing._locked = pacing._was_early = False
    now = ticks()
    return pacing.found(now, now)


period = pacing.period_us
pacing.period_us = 1000
show("pacing.Pacing.found, doubt", mean_us(doubt))
pacing.period_us = period
show("pacing.Pacing.early", mean_us(lambda: pacing.early(5)))
sensor.bus = bus

framer_touch = framer.touch
show("strip.Strip.take, whole", mean_us(strip.take))
framer.touch = nothing
show("strip.Strip.take", mean_us(strip.take))
strip.stream_touch = False
framer.spectrum = nothing
strip.stream_spectrum = True
show("strip.Strip.take with spectrum", mean_us(strip.take))
strip.stream_spectrum = False
strip._average = 2
show("strip.Strip.take, average=2", mean_us(strip.take))
strip._average = 1
strip._samples = 0
del framer.touch
del framer.spectrum
show("frame.Framer.touch", mean_us(lambda: framer.touch(0, strip.decode.state)))
show("frame.Framer.spectrum", mean_us(lambda: framer.spectrum(0, 1, 9, sensor.counts)))
show("frame.Framer.key", mean_us(lambda: framer.key(0, 7, 4, 0, True)))
show("frame.Framer.contact", mean_us(lambda: framer.contact(0, 1, 2, 40_000, 100, 3000)))
for size in (0, 100, 600):
    show("frame.Framer.text, %d bytes" % size, mean_us(partial(framer.text, bytes(size)), 20))
serial = StdioSerial()
row = bytearray(b"." * 27 + b"\n")


def write_paced():
    serial.write(row, 28)
    time.sleep_us(3000)


show(
    "StdioSerial.write of 28 bytes",
    mean_us(write_paced, 20) - mean_us(lambda: time.sleep_us(3000), 20),
)
show("StdioSerial.read, no byte", mean_us(serial.read))
show("uses.Uses.pump", mean_us(app.uses.pump))
show("time.sleep_us(1)", mean_us(lambda: time.sleep_us(1)))
reader = app._reader


def feed():
    reader.feed(65)
    reader._size = 0


show("command.LineReader.feed", mean_us(feed))

# Contacts and keys.
app.settings.values["keys"] = 1
print(app.apply_calibration())
uses = app.uses
tracker, keypad = uses._tracker, uses._keypad
state = strip.decode.state
weighed = array("i", (0, 0))
weigh = evidence.weigh


def timed(state):
    began = ticks()
    is_found = weigh(state)
    weighed[0] += 1
    weighed[1] += diff(ticks(), began)
    return is_found


evidence.weigh = timed
kinds, times = bytearray(1300), array("i", bytes(5200))


row = array("i", bytes(16))


def track():
    at = t = 0
    while readings.readinto(row) == 16:
        flags, x_um, force_mN, brightness = row
        t += _TICKS
        before_us = weighed[1]
        began = ticks()
        tracker.take(flags, x_um, force_mN, brightness, t)
        times[at] = diff(ticks(), began) - (weighed[1] - before_us)
        kinds[at] = 2 if tracker.two else 1 if tracker.touched else 0
        at += 1
    return at


gc.collect()
with open("readings.inputs", "rb") as readings:
    size = track()
evidence.weigh = weigh
for kind in range(3):
    us = sorted(times[i] for i in range(size) if kinds[i] == kind)
    name = ("up", "one", "two")[kind]
    show("tracker.ContactTracker.take, %s" % name, sum(us) / len(us))
    show("   count, median, last %d, %d," % (len(us), us[len(us) // 2]), us[-1])
show("weighed %d times, mean" % weighed[0], weighed[1] / weighed[0])
show("keypad.Keypad.tick", mean_us(lambda: keypad.tick(5)))


def skip(flags, position_um, force_mN, brightness, t):
    pass


tracker.take = skip
keypad.tick = nothing
show("uses.Uses.take", mean_us(lambda: uses.take(0, state)))
del tracker.take, keypad.tick
app.settings.values["keys"] = 0
app.apply_calibration()

silicone = Compensation([4096, 50, 100, 200, 200, 200, 200, 300, 3000, 30_000, 100, 100, 100])
clock = [0]


def compensate():
    clock[0] += 3
    silicone.take(state, clock[0])


show("silicone.Compensation.take", mean_us(compensate))


# Commands, without garbage collections and transfers.
class Later:
    """Replaces the module `gc` and collects nothing: collections are measured separately."""

    collect = nothing


def command_us(line, count=5):
    def handle():
        app.replies.send(app._commands.handle(line))

    return mean_us(handle, count)


show("gc.collect", mean_us(gc.collect, 5))
app_module.gc = command.gc = Later
_COMMANDS = "hello", "get", "sync", "stream touch", "set average=1", "set keys=1", "none"
for name in _COMMANDS:
    gc.collect()
    show("command " + name, command_us(name))
command_us("cal begin", 1)
gc.collect()
show("command cal LINE", command_us("cal " + line, 20))
began = ticks()
app.use_calibration(app.calibration.lines)
show("use_calibration", diff(ticks(), began))
strip.stop()
