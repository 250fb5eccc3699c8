"""A substitute for the package pynput."""
