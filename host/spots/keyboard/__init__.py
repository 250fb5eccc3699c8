"""Zones of a strip as keys: layouts, the key engine, `spots keyboard` and `spots keys`."""
