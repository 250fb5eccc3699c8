"""Measures the flash that the firmware needs on a board, and estimates the heap.

Flash is the size of the .mpy files. The heap is measured in MicroPython on this computer, while
readings are streamed: without and with a calibration, and with keys. Words have 64 bits here, 32
bits on a board. So code, constants and names are counted with their size in the .mpy files, and all
other bytes are counted half. USB and the gamepad are not loaded. The substitutes for bus, clock and
port are included; the memory of MicroPython itself is not.

The measured heap can include garbage. A module without constant objects has a pointer to the end of
its table of names (two bytes for each name). If this table fills whole blocks of 32 bytes, the
pointer is also the address of the next block, so MicroPython does not free that block.
"""

from __future__ import annotations

import tempfile
from pathlib import Path

from spots.deploy.build import build, files_of
from spots.deploy.staging import board_names, device_of
from spots.keyboard.layout import load

from .firmware import run_script

_PORTABLE = "virtual"
_RUNTIME = "spots_device/runtime/micropython.mpy"  # replaced by `canned` in the measurement


def measure(calibration: list[str]) -> dict:
    """Return the memory that each board with .mpy files needs, as a dict by name of the board.

    ``mpy_bytes`` are bytes of flash, ``loaded_bytes`` those of the modules that a board loads when
    it starts. ``started_bytes``, ``calibrated_bytes`` and ``typing_bytes`` are bytes of heap; the
    last ones are those with a calibration and the layout ``mini``.

    Parameters
    ----------
    calibration : list of str
        Lines of a calibration that was made on board ``00`` at the default settings.

    Raises
    ------
    SpotsError
        If mpy-cross or MicroPython is not installed.
    """
    names = [name for name in board_names() if device_of(name).runtime == "micropython"]
    with tempfile.TemporaryDirectory(prefix="spots-") as folder:
        builds = {name: build(name, Path(folder)) for name in names}
        sizes = {name: _mpy_bytes(built) for name, built in builds.items()}
        inputs = {"calibration": calibration, "layout": load("mini").lines}
        states = run_script(builds[_PORTABLE], inputs, "canned.py", "heap.py")
    spent = {}
    for name, of in sizes.items():
        spent[name] = {"mpy_bytes": sum(of.values())}
        for state, measured in states.items():
            here, there = (
                sum(files[path] for path in _loaded(measured["modules"], files))
                for files in (sizes[_PORTABLE], of)
            )
            code = there + of[_RUNTIME]
            spent[name].setdefault("loaded_bytes", code)
            spent[name][f"{state}_bytes"] = code + (measured["heap_bytes"] - here) // 2
    return spent


def _loaded(modules: list[str], files: dict[str, int]) -> list[str]:
    paths = [module.replace(".", "/") for module in modules]
    return [
        f"{path}{end}"
        for path in paths
        for end in (".mpy", "/__init__.mpy")
        if f"{path}{end}" in files
    ]


def _mpy_bytes(folder: Path) -> dict[str, int]:
    files = files_of(folder)
    return {path: len(data) for path, data in files.items() if path.endswith(".mpy")}
