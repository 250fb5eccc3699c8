"""Replaces MicroPython's library ``usb-device``."""
