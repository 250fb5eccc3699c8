"""Simulated sensor and virtual board, which share no code with the driver and the decoder."""
