"""The simulated sensor and the virtual board, without code of the firmware's driver and decoder."""
