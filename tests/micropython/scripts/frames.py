"""Prints whether any call of the loop allocates its call frame on the heap.

MicroPython frees such a frame when the call returns, so neither the used heap nor a locked heap
shows it. But the frame counts towards the threshold at which the garbage collector runs.
"""

import gc

import canned
from spots_device.board.app import Board
from spots_device.sensor.as7341 import AS7341

_SAMPLES = 500
_THRESHOLD_BYTES = 30_000  # more than the garbage that `litter` makes


def litter():
    for _ in range(100):
        bytes(100)


class Port:
    frames = 0

    def write(self, buffer, size):
        self.frames += 1
        return True

    def read(self):
        return -1


def play(app, port, frames):
    end = port.frames + frames
    while port.frames < end:
        app._pass()


def two_strips(port):
    """Return the application of a board with two strips, whose samples end 3 ms apart."""
    clock = canned.Clock()

    class TwoStrips(canned.BoardConfig):
        SENSORS = [{"LED_MAX_MA": 100}] * 2

    def open_sensor(config, clock):
        clock.sleep_us(3_000)
        return AS7341(canned.Bus(clock), clock)

    app = Board(TwoStrips, "canned", "00", open_sensor, clock, port)
    for part in app.strips:
        part.strip.stream_touch = True
    return app


def collects(function, *arguments):
    """Return whether the garbage collector ran during the call ``function(*arguments)``."""
    gc.collect()
    gc.threshold(_THRESHOLD_BYTES)
    litter()
    before = gc.mem_alloc()
    function(*arguments)
    after = gc.mem_alloc()
    gc.threshold(-1)
    return after < before


def deep(a, b, c, d, e, f, g, h, i, j, k):
    return a


def call_deep():
    for _ in range(_SAMPLES):
        deep(1, 2, 3, 4, 5, 6, 7, 8, 9, 10, 11)


port = Port()
app, bus, _, _ = canned.app((), port)
app.strips[0].strip.stream_spectrum = False
bus.counts((538, 548, 714, 916, 1247, 684))
play(app, port, 100)
both = two_strips(port)
play(both, port, 400)
print(
    collects(play, app, port, _SAMPLES),
    collects(play, both, port, _SAMPLES),
    collects(call_deep),
)
