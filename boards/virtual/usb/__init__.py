"""Stands for MicroPython's library ``usb-device``."""
