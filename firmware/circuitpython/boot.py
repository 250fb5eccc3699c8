"""Sets up USB on CircuitPython: a serial port for frames, and a drive writable for the board."""

from spots_device.board.circuitpython import boot

boot()
