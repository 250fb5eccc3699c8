"""Calibration of a board, computed from presses at known positions with known forces."""
