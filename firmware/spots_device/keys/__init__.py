"""Turns fingers into keys, axes and USB reports."""
