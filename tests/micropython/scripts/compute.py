"""Runs a trial while the heap is locked, and prints its results, one case per line.

Reads from given.json: ``trial``, the ``cases`` and how many results (``width``) each of them has.
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
# Before the cases are prepared: later no piece of the heap may be so large.
results = array("i", range(width * len(given["cases"])))
for i in range(len(results)):
    results[i] = 0
# Popped: they must not lie twice in a heap as small as a board's.
cases = getattr(trials, "prepare_" + given["trial"], list)(given.pop("cases"))
locked(getattr(trials, given["trial"]), cases, results)
for i in range(len(results)):
    print(results[i], end="\n" if (i + 1) % width == 0 else " ")
