"""Prints how much heap the application takes, calibrated and running."""

import gc
import json

import canned

with open("given.json") as file:
    given = json.load(file)
gc.collect()
made = canned.app(given["calibration"])
given = None
gc.collect()
print(gc.mem_alloc())
