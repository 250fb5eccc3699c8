"""Code for only one runtime, MicroPython or CircuitPython, and the code that both share."""
