"""Loses the sensor and starts it again; prints the bytes of garbage when the loop continues.

Reads ``calibration`` from given.json.
"""

import gc
import json

import canned
from spots_device.board.store import Store

_RETURNS = 3


class Absent:
    """I2C bus of a chip that does not answer."""

    def read_into(self, address, register, buffer):
        raise OSError(5)

    def write(self, buffer):
        raise OSError(5)

    def recover(self):
        pass


with open("given.json") as file:
    lines = json.load(file)["calibration"]
Store().save([("settings", ["keys=1"])])
board, bus, clock, _ = canned.app(lines)
app = board.strips[0]
lines = None
sensor = app.strip.sensor
for _ in range(_RETURNS):
    sensor.bus = Absent()
    while not app.reconnect.fault:
        board.step()
    sensor.bus = bus
    while app.reconnect.lost:
        board.step()
    gc.disable()
    before = gc.mem_alloc()
    gc.collect()
    print(before - gc.mem_alloc())
    gc.enable()
