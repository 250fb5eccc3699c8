"""Presses in, a calibration out: no board, no terminal and no clock."""
