"""Sets up USB on CircuitPython: a serial port for frames, and a drive that the board can write."""

from spots_device.runtime.circuitpython import boot

boot()
