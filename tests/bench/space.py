"""What the firmware takes of a board: flash for its modules, and heap once it runs.

The modules are weighed as they are built for the board. The heap is estimated from MicroPython in
words of 64 bits, streaming, before and with a calibration: code, constants and names are as long on
every board, about as the .mpy files hold them, and of all else half is left where a word is half as
long. Only what is loaded counts: keyboard and gamepad are not, unless they are switched on. What
stands in for bus, clock and port is counted too; what MicroPython itself takes at start is not.
"""

from __future__ import annotations

import tempfile
from pathlib import Path

from spots.deploy.build import build, files_of
from spots.deploy.staging import board_names, device_of

from .firmware import run_script

_PORTABLE = "virtual"
_PACKAGES = ("spots_device", "spots_device.runtime")
_RUNTIME = "spots_device/runtime/micropython.mpy"  # what stands for it was loaded instead


def measure(calibration: list[str]) -> dict:
    """Return, for every board that takes .mpy files, ``mpy_bytes``, ``started_bytes`` and
    ``calibrated_bytes``, the latter two of its heap.

    Parameters
    ----------
    calibration : list of str
        Lines of one made on board ``00`` at the default settings.

    Raises
    ------
    SpotsError
        If there is no mpy-cross or no MicroPython.
    """
    names = [name for name in board_names() if device_of(name).runtime == "micropython"]
    with tempfile.TemporaryDirectory(prefix="spots-") as folder:
        builds = {name: build(name, Path(folder)) for name in names}
        sizes = {name: _mpy_bytes(built) for name, built in builds.items()}
        inputs = {"calibration": calibration}
        measured = run_script(builds[_PORTABLE], inputs, "canned.py", "heap.py")
    loaded = [path for path in map(_path, measured["modules"]) if path in sizes[_PORTABLE]]
    code_here = sum(sizes[_PORTABLE][path] for path in loaded)
    spent = {}
    for name, of in sizes.items():
        spent[name] = {"mpy_bytes": sum(of.values())}
        code = sum(of[path] for path in (*loaded, _RUNTIME))
        for when in ("started_bytes", "calibrated_bytes"):
            spent[name][when] = code + (measured[when] - code_here) // 2
    return spent


def _path(module: str) -> str:
    path = module.replace(".", "/")
    return f"{path}/__init__.mpy" if module in _PACKAGES else f"{path}.mpy"


def _mpy_bytes(folder: Path) -> dict[str, int]:
    files = files_of(folder)
    return {path: len(data) for path, data in files.items() if path.endswith(".mpy")}
