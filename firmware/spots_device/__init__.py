"""Firmware of a SPOTS board: reads the light sensor AS7341, sends positions and forces of presses.

Data flows one way: sensing -> arithmetic -> frames, keys and gamepad. ``app`` contains the main
loop. ``runtime`` contains the code that differs between MicroPython and CircuitPython.
"""

__version__ = "0.2.0"
PROTOCOL = 3


def const(value):
    """Return `value`: MicroPython's ``const``, which Python does not have.

    The compilers of MicroPython and CircuitPython replace calls of ``const`` by their values, and
    need no import for this. ``spots build`` removes this function and its imports.
    """
    return value
