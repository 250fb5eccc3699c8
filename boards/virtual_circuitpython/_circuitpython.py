"""The steps of CircuitPython after a reset: run boot.py, start USB, run code.py."""

import builtins
import os
import sys

sys.path[0] = ""  # not this folder, which comes after the board's own files

import _simulator  # noqa: E402, F401
import storage  # noqa: E402
import usb_cdc  # noqa: E402
import usb_hid  # noqa: E402, F401

_ABOUT = (
    "Adafruit CircuitPython 10.3.1 on 2026-01-01; Virtual board with a simulator\n"
    "Board ID:virtual_circuitpython\nUID:%s\n"
)
_BUILT_IN = set(sys.modules)
_open = builtins.open


def _guarded_open(path, mode="r"):
    if isinstance(path, str) and storage.getmount("/").readonly and mode[0] != "r":
        raise OSError(30)  # EROFS
    return _open(path, mode)


def _describe(about):
    """Write boot_out.txt if its text changes; atomic: a real drive never shows a partial file."""
    try:
        with _open("boot_out.txt") as file:
            if file.read() == about:
                return
    except OSError:
        pass
    with _open("boot_out.new", "w") as file:
        file.write(about)
    os.rename("boot_out.new", "boot_out.txt")


def _run(name):
    try:
        with _open(name) as file:
            source = file.read()
    except OSError:
        return
    exec(compile(source, name, "exec"), {"__name__": "__main__"})


def _forget():
    """Remove the modules of a program; without the module `board`, all its pins are free again."""
    for module in list(sys.modules):
        if module not in _BUILT_IN:
            del sys.modules[module]


_describe(_ABOUT % os.getenv("SPOTS_BOARD_ID"))
builtins.open = _guarded_open
try:
    _run("boot.py")
except Exception as error:
    sys.print_exception(error)  # code.py still runs
_forget()
usb_cdc.start()
try:
    _run("code.py")
finally:
    _forget()
