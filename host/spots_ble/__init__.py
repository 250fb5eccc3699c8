"""Boards by Bluetooth LE: the port ``ble:NAME``, and the command ``spots radio``."""
