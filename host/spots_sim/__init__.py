"""The simulated sensor and the virtual board; shares no code with driver or decoder."""
