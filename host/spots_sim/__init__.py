"""The simulated sensor and the virtual board; shares no code with the driver and the decoder."""
