"""The strip: optics, silicone, changes since the calibration, and what happens to it over time."""
