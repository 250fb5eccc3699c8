"""Zones of a strip as keys: layouts, key events, ``spots keyboard`` and ``spots keys``."""
