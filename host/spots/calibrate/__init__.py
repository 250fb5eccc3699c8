"""Calibration of a board: sessions that ask for presses, the fit, calibration files, re-zero."""
