"""Counts in, position and force out: logarithms, calibration, dark frames, frames."""
