"""Runs the main file of a virtual board with the processor time of a slow board."""

import json
import os
import sys

sys.path[0] = ""  # not this folder, which comes after the board's own files

import _cpu  # noqa: E402
import _simulator  # noqa: E402

_cpu.slow_down("spots_device", json.loads(os.getenv("SPOTS_CPU")), _simulator.spend_us)
import main  # noqa: E402, F401
