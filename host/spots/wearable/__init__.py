"""Gestures on a worn strip: `spots wearable`."""
