"""What readings and a calibration say about a strip, and what to do."""
