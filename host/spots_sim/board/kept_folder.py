"""A folder with files that several processes reuse: calibrations, and compiled firmware.

The environment variable SPOTS_CALIBRATIONS names the folder; without it, nothing is stored. The
files are valid for one version of firmware and simulator. For another version, use an empty folder.
"""

from __future__ import annotations

import os
from collections.abc import Callable
from pathlib import Path

from spots.common import atomic
from spots.errors import SettingError

FOLDER = "SPOTS_CALIBRATIONS"


def kept_folder(name: str, make: Callable[[Path], object]) -> Path | None:
    """Return a stored folder, which ``make(path)`` of the first process that needs it fills.

    None if the environment variable SPOTS_CALIBRATIONS is not set.
    """
    root = os.environ.get(FOLDER)
    if not root:
        return None
    path = Path(root) / name
    if not Path(root).is_dir():
        raise SettingError(f"{FOLDER} names {root}, which is no folder: make it, or name another")
    if not path.exists():
        with atomic.folder(Path(root)) as temporary:
            made = temporary / name
            made.mkdir()
            make(made)
            try:
                made.rename(path)
            except OSError:
                if not path.exists():  # another process may have been faster
                    raise
    return path
