"""Calibration: converts presses at known positions and forces to the integers of the board."""
