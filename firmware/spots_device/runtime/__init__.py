"""Code that differs between MicroPython and CircuitPython: one module for each runtime."""
