"""Package ``usb`` of the virtual board; replaces MicroPython's library ``usb-device``."""
