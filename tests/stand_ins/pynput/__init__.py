"""A substitute for pynput."""
