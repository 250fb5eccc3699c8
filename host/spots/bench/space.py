"""What the firmware takes of a board: flash for its modules, and heap once it runs.

The modules are weighed as they are built for the board. The heap is estimated from MicroPython in
words of 64 bits, calibrated and streaming: code, constants and names are as long on every board,
about as the .mpy files hold them, and of all else half is left where a word is half as long. What
stands in for bus, clock and port is counted too; what MicroPython itself takes at start is not.
"""

from __future__ import annotations

import tempfile
from pathlib import Path

from ..build import build, files_of
from ..stage import board_names, device_of, stage
from .firmware import run_script

_PORTABLE = "virtual"


def run(calibration: list[str]) -> dict:
    """Return, for every board that takes .mpy files, ``mpy_bytes`` and ``heap_bytes``.

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
        codes = {name: _mpy_bytes(build(name, Path(folder) / "build")) for name in names}
        running = Path(folder) / "running"
        running.mkdir()
        stage(_PORTABLE, running)
        inputs = {"calibration": calibration}
        taken = run_script(running, inputs, "canned.py", "heap.py")["taken_bytes"]
    rest = (taken - codes[_PORTABLE]) // 2
    return {name: {"mpy_bytes": code, "heap_bytes": code + rest} for name, code in codes.items()}


def _mpy_bytes(folder: Path) -> int:
    return sum(len(data) for path, data in files_of(folder).items() if path.endswith(".mpy"))
