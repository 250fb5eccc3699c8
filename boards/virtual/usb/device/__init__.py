"""``usb.device`` of the virtual board: interfaces, and the device that they make up."""

_device = None


def get():
    global _device
    if not _device:
        _device = _Device()
    return _device


class _Device:
    def init(self, *itfs, **kwargs):
        if not kwargs.get("builtin_driver"):
            raise SystemExit  # no serial port any more: nobody could talk to this board
        for i in range(len(itfs)):
            descriptor = Descriptor(None)
            # Twice, as published: once to learn the size, once to write.
            itfs[i].desc_cfg(descriptor, 0, 0, [])
            itfs[i].desc_cfg(descriptor, i, i, [])
            itfs[i].on_open()


class Descriptor:
    """Keeps the last interface's numbers."""

    def __init__(self, b):
        self.b = b

    def interface(self, number, endpoints, kind, subclass, protocol, name=0):
        self.last = (number, endpoints, kind, subclass, protocol, name)
