"""Reads the AS7341: its registers, samples, exposure, and the LED."""
