"""USB HID: reports, their descriptors, and the USB stack of each runtime."""
