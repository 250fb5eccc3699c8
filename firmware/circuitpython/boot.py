"""Before USB starts, on CircuitPython: a port for frames, a drive that the board may write to."""

from tactile.runtime.circuitpython import boot

boot()
