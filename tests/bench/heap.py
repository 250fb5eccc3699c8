"""Script for MicroPython: prints the heap that the firmware uses in each of its states.

The states are: without a calibration, with one, and with keys and a layout.
"""

import gc
import json
import sys

import canned


def measured():
    gc.collect()
    return {"heap_bytes": gc.mem_alloc(), "modules": list(sys.modules)}


def given(name):
    with open("inputs.json") as file:
        return json.load(file)[name]


made = canned.app()
app = made[0].strips[0]
states = {}
states["started"] = measured()
app.use_calibration(given("calibration"))
states["calibrated"] = measured()
app.settings.change(["keys=1"])
app.use_layout(given("layout"))
states["typing"] = measured()
print(json.dumps(states))
