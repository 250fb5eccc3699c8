"""Stands in for pynput."""
