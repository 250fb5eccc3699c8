"""SPOTS on the board: counts of an AS7341 in, positions and forces out.

Data flows one way: sensing -> arithmetic -> outward. ``app`` is the loop that
joins them and ``runtime`` holds all that differs between MicroPython and
CircuitPython.
"""

__version__ = "0.2.0"
PROTOCOL = 2
