"""Runs in MicroPython: prints how much heap the application takes, calibrated and running."""

import gc
import json
import sys

import canned

with open("inputs.json") as file:
    given = json.load(file)
gc.collect()
made = canned.app(given["calibration"])
given = None
gc.collect()
taken = gc.mem_alloc()
print(json.dumps({"taken_bytes": taken, "modules": list(sys.modules)}))
