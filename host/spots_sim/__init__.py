"""The simulated sensor and the virtual board; shares no code with the sensor's driver or the decoder."""
