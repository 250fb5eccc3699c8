"""Runs a trial of trials.py while the heap is locked, and prints its results, one case per line.

Reads from given.json: ``trial``, the name of the trial; ``cases``, a list of its arguments; and
``width``, the number of results of each case.
"""

import gc
import json
from array import array

import trials
from locked import locked

gc.collect()
with open("given.json") as file:
    given = json.load(file)
width = given["width"]
# Allocated before the cases are prepared: later the heap may have no free block of this size.
results = array("i", range(width * len(given["cases"])))
for i in range(len(results)):
    results[i] = 0
# Popped, because a heap as small as that of a board has no room for two copies of the cases.
cases = getattr(trials, "prepare_" + given["trial"], list)(given.pop("cases"))
locked(getattr(trials, given["trial"]), cases, results)
for i in range(len(results)):
    print(results[i], end="\n" if (i + 1) % width == 0 else " ")
