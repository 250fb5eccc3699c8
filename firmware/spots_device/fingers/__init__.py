"""Finds which fingers touch the strip, and where."""
