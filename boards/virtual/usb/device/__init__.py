"""``usb.device`` of the virtual board: the USB device and its interfaces."""

_device = None


def get():
    global _device
    if not _device:
        _device = _Device()
    return _device


class _Device:
    def init(self, *itfs, **kwargs):
        if not kwargs.get("builtin_driver"):
            raise SystemExit  # without the built-in driver, the board has no serial port
        for i in range(len(itfs)):
            descriptor = Descriptor(None)
            # Two calls, like the published library: one for the size, one to write.
            itfs[i].desc_cfg(descriptor, 0, 0, [])
            itfs[i].desc_cfg(descriptor, i, i, [])
            itfs[i].on_open()


class Descriptor:
    """USB descriptor: stores the arguments of the last call of `interface`."""

    def __init__(self, b):
        self.b = b

    def interface(self, number, endpoints, kind, subclass, protocol, name=0):
        self.last = (number, endpoints, kind, subclass, protocol, name)
