"""What CircuitPython does after a reset: boot.py, then USB, then code.py, both from scratch."""

import builtins
import sys

sys.path[0] = ""  # not this folder, which comes after the board's own files

import _simulator  # noqa: E402, F401
import storage  # noqa: E402
import usb_cdc  # noqa: E402

_BUILT_IN = set(sys.modules)
_open = builtins.open


def _guarded_open(path, mode="r"):
    if isinstance(path, str) and storage.getmount("/").readonly and mode[0] != "r":
        raise OSError(30)  # EROFS
    return _open(path, mode)


def _run(name):
    try:
        with _open(name) as file:
            source = file.read()
    except OSError:
        return
    exec(compile(source, name, "exec"), {"__name__": "__main__"})


builtins.open = _guarded_open
try:
    _run("boot.py")
except Exception as error:
    sys.print_exception(error)  # and code.py runs all the same
for module in list(sys.modules):
    if module not in _BUILT_IN:
        del sys.modules[module]
usb_cdc.start()
_run("code.py")
