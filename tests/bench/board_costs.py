"""Measures processor times of the firmware on a board; runs on the board.

`bench.board_inputs` writes two files. Copy them to a board with firmware and a sensor:
``mpremote fs rm :main.py + fs cp calibration.inputs counts.inputs :``. Then
``mpremote run tests/bench/board_costs.py`` prints the times for docs/evidence/board-costs.md and
``host/spots_sim/data/cpus.toml``, after many dots that stand for the frames.

The sensor samples, but the counts come from a file, so no finger is necessary. The time of a
function does not include the other measured functions that it calls: they are replaced by empty
functions during its measurement.
"""

import gc
import time
from array import array

import board_config
import machine

from spots_device.board import app as app_module
from spots_device.board import command as command_module
from spots_device.board import strip_app as strip_module
from spots_device.board.settings import checksum
from spots_device.fingers import evidence
from spots_device.reading.calibration import Calibration
from spots_device.reading.silicone import Compensation
from spots_device.runtime.micropython import MachineBus, StdioSerial
from spots_device.sensor.as7341 import AS7341

_CALLS = 200  # of a function
_LOOP_MS = 500  # of a loop
_SETTLE_MS = 200
_START_MS = 1500  # after a start of the sensor: a dark frame, and the fit of the pacing
_EXPOSURES_US = 10_000, 5_000, 2_780, 1_500, 1_000
# Values of constants, whose names are not on a board: decode.COUNTS, USE and AVERAGE.
_COUNTS, _USE, _AVERAGE = 2, 6, 34
_ADDRESS, _LEVEL, _DATA = 0x39, 0xFD, 0xFE

ticks, diff = time.ticks_us, time.ticks_diff
rows = []


def nothing(*_):
    return True


def show(name, us):
    rows.append("%-44s %9.1f" % (name, us))


def mean_us(function, count=_CALLS):
    """Return the mean duration of a call in us, without the loop around it."""
    function()
    gc.collect()
    began = ticks()
    for _ in range(count):
        function()
    return diff(ticks(), began) / count - empty_us


empty_us = 0.0
empty_us = mean_us(lambda: None)

with open("calibration.inputs") as file:
    lines = file.read().split("\n")
with open("counts.inputs") as file:
    samples = [array("i", map(int, row.split())) for row in file]
uid = "".join("%02x" % byte for byte in machine.unique_id())
lines = ["board " + uid if line.startswith("board ") else line for line in lines]
bus = MachineBus(
    board_config.I2C_ID, board_config.SCL_PIN, board_config.SDA_PIN, board_config.I2C_HZ
)
port = StdioSerial()
board = app_module.Board(board_config, "micropython", uid, lambda *_: AS7341(bus, time), time, port)
(app,) = board.strips
strip, framer, outputs, handle = app.strip, board.framer, app.outputs, board._commands.handle
sensor, state, take, work = strip.sensor, strip.decode.state, strip.take, strip._work
pacing = sensor.pacing
write, dots = port._out, b"." * 31 + b"\n"
steady = [array("i", bytes(24))]  # counts of the next samples
slept = array("i", (0, 0, 0, 0))  # time and number of all sleeps; frames; calls of `weigh`
began = _LOOP_MS


def out(block, begin, size=0):
    """Send dots in the place of a block, because mpremote reads text; count frames.

    The arguments are a block and its size, or those of the second block of a frame: buffer, begin
    and size.
    """
    if size:
        return write(dots, size)
    slept[2] += 1
    if slept[2] == limit:
        board.reboot = True
    return write(dots, begin)


def sleep_us(us):
    woke = ticks()
    time.sleep_us(us)
    slept[0] += diff(ticks(), woke)
    slept[1] += 1
    work[_COUNTS] = steady[slept[1] % len(steady)]
    if diff(ticks(), began) > loop_us:
        board.reboot = True


def run(ms):
    """Run the loop for a time; a loop that never sleeps, for three frames per sample. Return us."""
    global began, loop_us, limit
    loop_us, limit = 1000 * ms, 3000 * ms // (sensor.exposure_us or 1000)
    for i in range(4):
        slept[i] = 0
    board.reboot = False
    began = ticks()
    board.step(False)
    return diff(ticks(), began)


def touch(fingers):
    """Play the counts of a strip without a finger, then those with up to `fingers` fingers."""
    global steady
    rows = [row for row in samples if row[0] <= fingers]
    for row in samples[:1] * 10 + rows:
        steady = [array("i", [n * sensor.exposure_us // 10_000 for n in row[1:]])]
        complete = sensor.complete
        while sensor.complete == complete:
            board.step()
    steady = [array("i", [n * sensor.exposure_us // 10_000 for n in row[1:]]) for row in rows[-20:]]
    if (state[0] & 1, outputs.two) != (fingers > 0, outputs.active and fingers > 1):
        raise ValueError("%d fingers: %s" % (fingers, list(state)[:5]))


def measure(name, fingers=1):
    """Return the time of a sample in the loop with a number of fingers."""
    run(_SETTLE_MS)
    touch(fingers)
    gc.collect()
    run(_SETTLE_MS // 4)  # the samples that waited
    missed, dropped = pacing.missed, framer.dropped
    us = run(_LOOP_MS)
    busy_us = us - slept[0]
    if slept[1]:
        busy_us -= slept[1] * pass_us + slept[2] * frame_us
    found_us = busy_us * sensor.exposure_us / us
    show("loop, " + name, found_us)
    rows[-1] += "  load %5.1f %%  frames/s %6.1f  missed %d  dropped %d  weighed %d" % (
        100 * busy_us / us,
        1e6 * slept[2] / us,
        pacing.missed - missed,
        framer.dropped - dropped,
        slept[3],
    )
    return found_us


def waiting():
    """Fetch a sample that a read of the FIFO has left."""
    sensor.at -= 12
    sensor.waits = 2
    sensor.poll()


def weigh(s):
    slept[3] += 1
    return weighs(s)


# What this script adds to each pass and to each frame.
board.sleep_us, port._out = sleep_us, out
board._pass = lambda: sleep_us(1)
us = run(_LOOP_MS)
pass_us = (us - slept[0]) / slept[1]
del board._pass
write, raw = nothing, write
frame_us = mean_us(lambda: out(dots, 32)) - mean_us(lambda: nothing(dots, 32))
write = raw
board.reboot = False
board.step()
note = app.use_calibration(lines)
if note:
    raise ValueError(note)

# The loop.
handle("stream touch")
for exposure_us in _EXPOSURES_US:
    handle("set exposure_us=%d" % exposure_us)
    run(_START_MS)
    measure("%d us" % exposure_us)
handle("set exposure_us=5000")
run(_START_MS)
touch_us = measure("stream touch")
handle("stream off")
off_us = measure("stream off")
handle("stream touch spectrum")
spectrum_us = measure("stream touch spectrum") - touch_us
handle("stream touch contact")
contacts_us = [measure("contacts, %d fingers" % n, n) - touch_us for n in range(3)]
handle("stream touch")
handle("set average=2")
measure("average=2")
handle("set average=1")
handle("set keys=1")
weighs, evidence.weigh = evidence.weigh, weigh
keys_us = [measure("keys, %d fingers" % fingers, fingers) - touch_us for fingers in range(3)]
evidence.weigh = weighs
tracker = outputs._tracker
show("evidence.weigh", mean_us(lambda: weighs(tracker.state)))
show("spectrum, in addition", spectrum_us)
for fingers in range(3):
    show("contacts, in addition: %d fingers" % fingers, contacts_us[fingers])
    show("keys, in addition: %d fingers" % fingers, keys_us[fingers])
touch(1)

# The bus.
for name, register, size in (
    ("level", _LEVEL, 1),
    ("sample", _DATA, 12),
    ("20 samples", _DATA, 240),
    ("level and sample", _LEVEL, 13),
):
    buffer = bytearray(size)
    bus_us = mean_us(lambda at=register, to=buffer: bus.read_into(_ADDRESS, at, to))
    show("bus, " + name, bus_us)

# A sample. The times of what is not measured alone are differences of loops.
outputs.take = strip._send = nothing
used_us = mean_us(take)
show("Strip.take, used", used_us)
del outputs.take
use, work[_USE] = work[_USE], None
reading_us = mean_us(take)
show("Strip.take, reading", reading_us)
strip.stream_touch = False
silent_us = mean_us(take)
show("Strip.take, without a frame", silent_us)
strip.stream_touch = True
strip._rare = True
show("Strip.take, rare", mean_us(take))
strip._rare = False
state[_AVERAGE] = _CALLS + 2
take()
show("Strip.take, sample", mean_us(take))
state[_AVERAGE] = 1
take()
work[_USE] = use
strip._send = framer.send
outputs._track = nothing
outputs_us = used_us - reading_us + mean_us(lambda: outputs.take(state))
show("Outputs.take", outputs_us - used_us + reading_us)
del outputs._track


def pump():
    outputs._until = 5
    outputs.pump()


pump_us, idle_us = mean_us(pump), mean_us(outputs.pump)
show("Outputs.pump", idle_us)
show("Engine.tick", pump_us - idle_us)
for fingers in range(3):
    show("ContactTracker.take, %d fingers" % fingers, keys_us[fingers] - outputs_us - pump_us)
app.poll, board.sleep_us, outputs.pumps = lambda: False, nothing, False
loop_pass_us = mean_us(board._pass)
app.poll, board.sleep_us, outputs.pumps = sensor.poll, sleep_us, True
show("Board._pass", loop_pass_us)
poll_us = mean_us(waiting)
sensor.waits = 0
show("AS7341.poll", poll_us)
show("Fifo.read", off_us - loop_pass_us - silent_us - bus_us - poll_us)
show("Pacing.early", mean_us(lambda: pacing.early(5)))
send_us = touch_us - off_us - reading_us + silent_us
show("Framer.send, with the port", send_us)
show("Framer.spectrum", spectrum_us - send_us)
framer.send = nothing
show("Framer.key", mean_us(lambda: framer.key(0, 7, 4, 0, True)))
frame_us = mean_us(lambda: framer.contact(0, 1, 2, 40_000, 100, 3000))
show("Framer.contact", frame_us)
one_us = keys_us[1] - pump_us
show("Fingers.send", contacts_us[1] - one_us - frame_us - send_us)
del framer.send
silicone = Compensation([4096, 50, 100, 200, 200, 200, 200, 300, 3000, 30_000, 100, 100, 100])
clock = [0]


def compensate():
    clock[0] += 3
    silicone.take(state, clock[0])


show("Compensation.take", mean_us(compensate))

# Commands, without garbage collections and the port.
reader = board._reader


def feed():
    reader.feed(65)
    reader._size = 0


class Later:
    """Replaces the module `gc` and collects nothing."""

    collect = nothing


show("LineReader.feed", mean_us(feed))
show("gc.collect", mean_us(gc.collect, 5))
app_module.gc = command_module.gc = strip_module.gc = Later
framer._write = nothing
for line in ("hello", "get", "sync", "stream touch", "set average=1", "set keys=1", "cal begin"):
    show("command " + line, mean_us(lambda line=line: app.replies.send(handle(line)), 5))
app.use_calibration([])
show("checksum", mean_us(lambda: checksum(lines), 1))
show("Calibration", mean_us(lambda: Calibration(lines, 0), 1))
strip.stop()
print()
for row in rows:
    print(row)
print("end")
