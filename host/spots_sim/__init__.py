"""The simulated sensor and the virtual board. Knows neither the driver nor the decoder."""
