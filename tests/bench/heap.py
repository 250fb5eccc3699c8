"""Script for MicroPython: prints the heap that the firmware uses without and with a calibration."""

import gc
import json
import sys

import canned

made = canned.app()
gc.collect()
started = gc.mem_alloc()
with open("inputs.json") as file:
    made[0].use_calibration(json.load(file)["calibration"])
file = None
gc.collect()
print(
    json.dumps(
        {
            "started_bytes": started,
            "calibrated_bytes": gc.mem_alloc(),
            "modules": list(sys.modules),
        }
    )
)
