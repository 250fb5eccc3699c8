"""Calibration: presses at known places and forces in, the board's integers out."""
