"""Gestures on a strip that is worn on the body: ``spots wearable``."""
