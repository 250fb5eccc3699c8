"""Processes readings of fingers while the heap is locked; prints two sums after each reading.

Each line of given.json is a case: lines of a layout, length of the strip in um, decay,
cross-sensitivity, and five integers for each reading, which are the arguments of
`tracker.ContactTracker.take`. The sums depend on the state of the tracker and on all its events.
"""

import gc
import json
from array import array

from locked import locked

from spots_device.fingers.state import SIZE
from spots_device.fingers.tracker import ContactTracker
from spots_device.keys.layout import parse


class Sum:
    """Receives the events of a contact tracker; `value` depends on all of them, in 24 bits."""

    def __init__(self):
        self.value = 0

    def add(self, kind, x_um=0, slack_um=0):
        value = (31 * self.value + kind) & 0xFFFFFF
        value = (31 * value + (x_um & 0xFFFFFF)) & 0xFFFFFF
        self.value = (31 * value + (slack_um & 0xFFFFFF)) & 0xFFFFFF

    def down(self, x_um, t):
        self.add(1, x_um)

    def at(self, x_um, t):
        self.add(2, x_um)

    def firm(self, t):
        self.add(3)

    def up(self, t):
        self.add(4)

    def next(self, x_um, t):
        self.add(5, x_um)

    def second(self, x_um, slack_um, t):
        self.add(6, x_um, slack_um)
        return self.value & 7 > 0  # seldom false: then this finger is not used

    def left(self, second, t):
        self.add(7, 1 if second else 0)

    def moved(self, x_um, slack_um):
        self.add(8, x_um, slack_um)

    def stuck(self):
        self.add(9)


def track(readings, results):
    s = tracker.state
    for i in range(0, len(readings), 5):
        tracker.take(
            readings[i], readings[i + 1], readings[i + 2], readings[i + 3], readings[i + 4]
        )
        value = 0
        for j in range(SIZE):
            value = (31 * value + (s[j] & 0xFFFFFF)) & 0xFFFFFF
        results[i] = value
        results[i + 1] = events.value


with open("given.json") as file:
    for line in file:
        gc.collect()
        given = json.loads(line)
        events = Sum()
        tracker = ContactTracker(events)
        tracker.set_layout(parse(given[0]), given[1], given[2], given[3])
        readings = array("i", given[4:])
        del given
        results = array("i", readings)
        locked(track, readings, results)
        for i in range(0, len(results), 5):
            print(results[i], results[i + 1])
