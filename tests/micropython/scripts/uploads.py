"""Uploads a layout and a calibration while samples arrive and keys are on, also in a full heap.

Reads ``calibration`` and ``layout`` from given.json. Prints JSON: for each round of uploads, the
bytes of heap in use and the notes of the board; the errors in a full heap; then the notes of a last
round, and the names of all loaded modules.
"""

import gc
import json
import sys

import canned
from spots_device.board.store import Store

_ROUNDS = 4
_STEPS = 300

with open("given.json") as file:
    given = json.load(file)
Store().save([("settings", ["keys=1"])])
board, _, _, _ = canned.app(given["calibration"])
app = board.strips[0]


def upload():
    notes = app.use_layout(given["layout"]), app.use_calibration(given["calibration"])
    for _ in range(_STEPS):
        board.step()
    return notes


def refused(use, lines):
    try:
        use(lines)
    except MemoryError:
        return True
    return False


for _ in range(_ROUNDS):
    notes = upload()
    gc.collect()
    print(json.dumps([gc.mem_alloc(), notes]))
gc.collect()
full = []
size = 4096
while size > 16:
    try:
        full.append(bytearray(size))
    except MemoryError:
        size >>= 1
calibration = app.strip.decode.calibration
errors = [refused(app.use_calibration, given["calibration"])]
errors.append(refused(app.use_layout, given["layout"]))
full = None
print(json.dumps([errors, calibration is app.strip.decode.calibration]))
calibration = None
print(json.dumps([upload(), sorted(sys.modules)]))
