"""Measures simulated strips, and scores typing, controllers and linkages."""
