"""`storage` of the virtual board: only the host can write to the drive until `remount`."""


class VfsFat:
    def __init__(self):
        self.readonly = True


_root = VfsFat()


def getmount(mount_path):
    return _root


def remount(mount_path, readonly=False, *, disable_concurrent_write_protection=False):
    _root.readonly = readonly
