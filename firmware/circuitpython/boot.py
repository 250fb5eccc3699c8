"""Before USB starts, on CircuitPython: a port for frames, a drive that the board may write to."""

from spots_device.runtime.circuitpython import boot

boot()
