"""SPOTS on the board: reads counts of an AS7341 and sends positions and forces.

Data flows one way: sensing -> arithmetic -> frames, keys and gamepad. ``app`` contains the loop
that joins them. ``runtime`` contains the code that differs between MicroPython and CircuitPython.
"""

__version__ = "0.2.0"
PROTOCOL = 2
