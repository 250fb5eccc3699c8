"""Firmware of a SPOTS board: reads counts of the sensor AS7341, sends positions and forces.

Data flows one way: sensing -> arithmetic -> frames, keys and gamepad. ``app`` contains the loop
that runs these stages. ``runtime`` contains the code that differs between MicroPython and
CircuitPython.
"""

__version__ = "0.2.0"
PROTOCOL = 2
