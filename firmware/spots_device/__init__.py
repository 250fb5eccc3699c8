"""Firmware of a SPOTS board: reads the light sensor AS7341, sends positions and forces of presses.

Data flows one way: sensing -> arithmetic -> frames, keys and gamepad. ``app`` contains the main
loop. ``runtime`` contains the code that differs between MicroPython and CircuitPython.
"""

__version__ = "0.2.0"
PROTOCOL = 2
