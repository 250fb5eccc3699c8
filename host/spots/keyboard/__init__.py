"""Zones of a strip as keys: layouts, key engine, ``spots keyboard`` and ``spots keys``."""
